"""What Windows lacks is hidden from the program, in its own processes: all that people use works.

Nothing here ran on Windows. `posix_hidden/sitecustomize.py` is loaded by each process of a test.
"""

from __future__ import annotations

import ast
import contextlib
import http.client
import json
import os
import pty
import re
import signal
import socket
import subprocess
import sys
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.ui import wire
from tests.drivers.receiver_bytes import EPOCH
from tests.lab.labelling.photographs import make_photographs
from tests.ui.client import Page
from tests.waiting import PATIENCE_S

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
pytest.importorskip("websockets")

HIDING = Path(__file__).parent / "posix_hidden"
SOURCE = Path(__file__).parents[2] / "src" / "agribot"
POSIX = {"curses", "fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}
VERSION = b'{"class":"VERSION","release":"3.22"}\r\n'
TPV = {
    "class": "TPV", "device": "COM3", "mode": 3, "status": 3, "time": EPOCH.isoformat(),
    "lat": 21.16129, "lon": 72.78702, "altHAE": 10.0, "eph": 0.02, "speed": 0.0, "track": 0.0,
}  # fmt: skip


@pytest.fixture(autouse=True)
def _hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    path = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(HIDING), path])))


def start(*words: str, stdin: int = subprocess.DEVNULL) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "agribot.cli", *words]
    return subprocess.Popen(
        command, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@contextlib.contextmanager
def serving(*words: str) -> Iterator[int]:
    """The port of a command's page; it is interrupted at the end."""
    process = start(*words, "--port", "0")
    assert process.stderr is not None
    said = []
    try:
        for line in process.stderr:
            said.append(line)
            found = re.match(r"page: http://127\.0\.0\.1:(\d+)/", line)
            if found:
                yield int(found[1])
                break
        assert found, said
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)


def test_no_module_needs_at_its_head_what_posix_alone_has() -> None:
    needs = {
        str(file.relative_to(SOURCE)): name
        for file in SOURCE.rglob("*.py")
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        for name in list_imports(node)
        if name in POSIX
    }
    assert needs == {}


def list_imports(node: ast.stmt) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ""] if isinstance(node, ast.ImportFrom) else []


@pytest.fixture
def gpsd() -> Iterator[int]:
    """The port of a gpsd with one receiver that stands."""
    ended = threading.Event()

    def serve(line: socket.socket) -> None:
        with line, contextlib.suppress(OSError):
            line.sendall(VERSION)
            while not ended.wait(0.1):
                line.sendall(json.dumps(TPV).encode() + b"\r\n")

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                threading.Thread(target=serve, args=(server.accept()[0],), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=accept, daemon=True).start()
        yield server.getsockname()[1]
        ended.set()
        server.shutdown(socket.SHUT_RDWR)


def test_a_receiver_at_gpsd_is_shown(gpsd: int) -> None:
    show = start("gnss", "show", f"gpsd://127.0.0.1:{gpsd}", "--for", "100")
    assert show.stderr is not None
    assert any("RTK fixed" in line for line in show.stderr)
    show.send_signal(signal.SIGINT)
    show.communicate(timeout=PATIENCE_S)
    assert show.returncode == 0


def test_the_page_shows_fixes_from_gpsd_and_keys_of_a_console_drive_the_robot(
    gpsd: int, tmp_path: Path
) -> None:
    source = ["--source", f"gnss=gpsd://127.0.0.1:{gpsd}"]
    settings = ["--set", "perception.enabled=false", "--set", "mission.waits_for_goals=true"]
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    with serving(
        "run", "farm", "--ui", "--stay", *source, *settings, "--out", str(tmp_path / "run")
    ) as port:
        teleop = start("teleop", "keyboard", "--hold", "1", "--port", str(port), stdin=theirs)
        with Page(port) as page:
            while (fix := page.receive(wire.State).gnss) is None:
                pass
            assert fix.lat_deg == pytest.approx(TPV["lat"], abs=1e-7)
            while (page.receive(wire.State).v_mps or 0.0) < 0.1:
                os.write(ours, b"\xe0H")  # what a console gives for the arrow up
        os.write(ours, b"q")
        _, said = teleop.communicate(timeout=PATIENCE_S)
        assert teleop.returncode == 0, said
    os.close(ours)
    os.close(theirs)


def test_photographs_are_labelled_on_their_page(tmp_path: Path) -> None:
    folder = make_photographs(tmp_path / "photos")
    with serving("label", str(folder)) as port:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
        with contextlib.closing(connection):
            connection.request("GET", "/api/v1/pictures")
            assert json.loads(connection.getresponse().read())["pictures"]


def test_a_console_reports_no_mouse() -> None:
    ours, theirs = pty.openpty()
    teleop = start("teleop", "mouse", "--url", "ws://127.0.0.1:1", "--token", "x", stdin=theirs)
    _, said = teleop.communicate(timeout=PATIENCE_S)
    assert teleop.returncode == 2
    assert "teleop mouse: this console reports no mouse" in said
    os.close(ours)
    os.close(theirs)
