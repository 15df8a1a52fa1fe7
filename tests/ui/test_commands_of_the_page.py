from __future__ import annotations

import contextlib
import io
import json
import re
import runpy
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.ui import panels, wire
from tests import nightly
from tests.ui.client import Browser, Page
from tests.waiting import PATIENCE_S

EXAMPLE = Path(__file__).parents[2] / "examples" / "03_panels_of_your_own.py"
AGRIBOT = (sys.executable, "-m", "agribot.cli")
RUN = ["run", "farm", "--set", "perception.enabled=false"]


@pytest.fixture(scope="module")
def run_in_a_script(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, str]:
    """The folder of a short run with its page, its exit status and what it said."""
    out = tmp_path_factory.mktemp("runs") / "run"
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        status = main([*RUN, "--ui", "--port", "0", "--for", "4", "--out", str(out)])
    return out, status, said.getvalue()


def test_a_run_with_a_page_ends_by_itself_where_nobody_sits_at_a_terminal(
    run_in_a_script: tuple[Path, int, str],
) -> None:
    out, status, said = run_in_a_script
    assert re.search(r"page: http://127\.0\.0\.1:\d+/", said), said
    assert status == 1, "the mission was cut short"
    assert (out / "report.json").is_file()


def test_a_robot_that_stays_is_driven_by_hand_after_its_mission(tmp_path: Path) -> None:
    words = ["--ui", "--stay", "--port", "0", "--for", "4", "--out", str(tmp_path / "run")]
    process = subprocess.Popen([*AGRIBOT, *RUN, *words], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        port = 0
        for line in process.stderr:
            found = re.match(r"page: http://127\.0\.0\.1:(\d+)/", line)
            port = int(found[1]) if found else port
            if line.startswith("the robot stays ready"):
                break
        with Page(port) as page:
            page.take_seat()
            state = page.receive(wire.State)
            for _ in range(200):
                page.send(wire.DriveByHand(v_mps=0.3, yaw_rate_radps=0.0))
                state = page.receive(wire.State)
                if state.v_mps and state.v_mps > 0.1:
                    break
            assert state.v_mps and state.v_mps > 0.1
            assert state.mode == "teleop"
            process.send_signal(signal.SIGINT)
            assert page.receive(wire.Bye).reason
        assert process.wait(PATIENCE_S) == 1
    finally:
        process.kill()
        process.communicate()


@nightly.by_day("test_a_robot_that_stays_is_driven_by_hand_after_its_mission")
def test_ctrl_c_at_the_very_address_of_the_page_ends_the_run_with_its_report(
    tmp_path: Path,
) -> None:
    out = tmp_path / "run"
    process = subprocess.Popen(
        [*AGRIBOT, *RUN, "--ui", "--port", "0", "--out", str(out)],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    try:
        next(line for line in process.stderr if line.startswith("page: "))
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 130, said
        assert "interrupted" in json.loads((out / "report.json").read_text())["reason"]
    finally:
        process.kill()
        process.communicate()


def test_a_recording_is_shown_without_a_robot(
    run_in_a_script: tuple[Path, int, str],
) -> None:
    out, _, _ = run_in_a_script
    process = subprocess.Popen(
        [sys.executable, "-m", "agribot.cli", "ui", str(out / "run.mcap"), "--port", "0"],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    try:
        found = re.match(r"page: http://127\.0\.0\.1:(\d+)/", process.stderr.readline())
        assert found
        browser = Browser(int(found[1]))
        assert browser.ask("GET", "/api/v1/session")[1]["source"] == "replay"
        with Page(int(found[1])) as page:
            assert page.receive(wire.State).mode == "replay"
            assert not page.ask(wire.TakeSeat()).ok
            process.send_signal(signal.SIGTERM)  # with its lines open
            assert process.wait(PATIENCE_S) == 0
    finally:
        process.kill()
        process.communicate()


def test_a_port_that_is_taken_is_said_before_anything_moves(tmp_path: Path) -> None:
    words = ["run", "farm", "--ui", "--host", "192.0.2.77", "--port", "1", "--out", str(tmp_path)]
    assert main(words) == 2


def test_the_example_adds_its_panels(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE)])
    monkeypatch.setattr(panels, "shared", panels.Panels())
    for name in ("layer", "button", "form", "image", "plot"):
        monkeypatch.setattr(panels, name, getattr(panels.shared, name))
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert "1 marks" in capsys.readouterr().out


def test_the_benchmark_counts_states_and_ticks(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["bench", "ui", "--no-camera", "--json", "--clients", "0,2", "--seconds", "2"]
    status = main(words)
    assert status in {0, 1}  # a busy machine is slower than it should be
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["ok"] == (status == 0) == all(one["ok"] for one in result["limits"])
    none, two = result["phases"]
    assert none["state_hz"] is None
    assert two["state_hz"] > 0.0
    assert two["server_rss_bytes"] > 1e6
    assert none["ticks"] > 0
