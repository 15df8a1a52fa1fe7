"""`agribot board` identifies boards, reports their state, and has avrdude flash them."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.cli.tools import board as board_command
from agribot.core.fact_text import render
from agribot.core.facts import BoardStopped
from agribot.drivers.board.board_codec import BoardDecoder, encode
from agribot.drivers.board.board_protocol import (
    LAYOUT,
    PROTOCOL,
    AskVersion,
    BoardFlag,
    BoardImu,
    BoardKind,
    BoardVersion,
)
from agribot.drivers.probe import found_devices
from agribot.drivers.probe.found_devices import FoundDevice
from tests.drivers.board_emulator import BoardEmulator
from tests.drivers.lines import Line
from tests.waiting import interrupted_once

pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Line]:
    line = Line(tmp_path)
    yield line
    line.unplug()


@contextlib.contextmanager
def living(line: Line, live: Callable[[bytes], bytes]) -> Iterator[list[bytes]]:
    """Let a board live at a line; gives what it heard."""
    ended, heard = threading.Event(), list[bytes]()

    def run() -> None:
        while not ended.wait(0.01):
            heard.append(line.hear())
            line.blurt(live(heard[-1]))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield heard
    finally:
        ended.set()
        thread.join()


class LinesThenFrames:
    """An IMU board: lines, until it is asked."""

    def __init__(self) -> None:
        self._decoder, self._is_asked = BoardDecoder("host"), False

    def live(self, data: bytes) -> bytes:
        if any(isinstance(frame.message, AskVersion) for frame in self._decoder.feed(data)):
            self._is_asked = True
            return encode(0, BoardVersion(
                protocol=PROTOCOL, board=BoardKind.IMU, layout=LAYOUT, firmware=(1, 2, 3),
                reset_cause=0,
            ))  # fmt: skip
        return encode(1, BoardImu(
            t_us=1, accel_mps2=(0.0, 0.0, 9.8), temperature_c=20.0, gyro_radps=(0.0, 0.0, 0.0),
            mag_t=(0.0, 0.0, 0.0), mag_count=0, flags=BoardFlag(0),
        )) if self._is_asked else b"A0B0C16384D131E0F0G\r\n"  # fmt: skip


def test_a_motor_board_is_told_with_what_stops_it(
    line: Line, capsys: pytest.CaptureFixture[str]
) -> None:
    board = BoardEmulator()
    board.is_button_pressed = True

    def live(data: bytes) -> bytes:
        board.feed(data)
        return board.advance()

    with living(line, live):
        assert main(["board", "show", f"serial:{line.path}", "--json"]) == 0
    out, told = capsys.readouterr()
    assert (
        "motor board, firmware 1.0.0" in told and render(BoardStopped(("began", "button"))) in told
    )
    assert "battery 25.2 V" in told and "estop pressed" in told
    assert json.loads(out)["version"]["board"] == BoardKind.MOTOR


def test_a_board_is_looked_for_at_every_free_line_where_none_is_named(
    line: Line, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def list_lines(*paths: str) -> None:
        found = [
            FoundDevice(
                kind="serial", path=path, node=path, what="Arduino", group="dialout",
                is_usable=path != "/dev/locked",
            )
            for path in paths
        ]  # fmt: skip
        monkeypatch.setattr(found_devices, "find_serial_lines", lambda root: iter(found))

    list_lines("/dev/locked")
    assert main(["board", "show"]) == 2
    assert (
        "none of 1 serial lines is free; connect the board's USB cable" in capsys.readouterr().err
    )
    list_lines("/dev/not-there", str(line.path))
    with living(line, LinesThenFrames().live):
        assert main(["board", "show"]) == 0
    assert "imu board, firmware 1.2.3" in capsys.readouterr().err


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Lines of `agribot board show`, as it prints them."""
    lines: list[str] = []
    monkeypatch.setattr(board_command, "print_line", lines.append)
    return lines


def test_the_state_of_a_board_is_told_on_while_a_person_tries_its_inputs(
    line: Line, told: list[str]
) -> None:
    board = BoardEmulator()

    def live(data: bytes) -> bytes:
        board.feed(data)
        board.is_bumper_pressed = True
        return board.advance()

    with living(line, live), interrupted_once(lambda: len(told) > 1 and "bumper" in told[-1]):
        assert main(["board", "show", f"serial:{line.path}", "--for", "600"]) == 0
    assert "bumper pressed" in told[-1] and "counts 0 0 0 0" in told[-1]


def test_an_imu_board_is_told_from_a_motor_board(
    line: Line, capsys: pytest.CaptureFixture[str]
) -> None:
    with living(line, LinesThenFrames().live):
        assert main(["board", "show", f"serial:{line.path}"]) == 0
    told = capsys.readouterr().err
    assert "imu board, firmware 1.2.3" in told and "0.00, 0.00, 9.80 m/s2" in told


def test_a_board_of_another_table_is_to_be_flashed(
    line: Line, capsys: pytest.CaptureFixture[str]
) -> None:
    board = BoardEmulator(layout=7)

    def live(data: bytes) -> bytes:
        board.feed(data)
        return board.advance()

    with living(line, live):
        assert main(["board", "show", f"serial:{line.path}"]) == 1
    told = capsys.readouterr().err
    assert "agribot board flash motor" in told
    assert "battery" not in told and "stopped" not in told, "read by another table"


def test_a_board_that_falls_silent_is_not_told_as_it_was(line: Line, told: list[str]) -> None:
    board = BoardEmulator()

    def live(data: bytes) -> bytes:
        board.feed(data)
        said = board.advance()
        return b"" if told else said

    def is_silent() -> bool:
        return bool(told) and told[-1].startswith("nothing from the board for ")

    with living(line, live), interrupted_once(is_silent):
        assert main(["board", "show", f"serial:{line.path}", "--for", "600"]) == 1
    assert "battery 25.2 V" in told[0]
    assert is_silent() and "battery" not in told[-1]


def test_what_is_no_word_of_a_board_is_told_with_its_length(
    line: Line, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agribot.drivers.probe.board_probe.BoardProbe.ask.__defaults__", (0.5,))
    with living(line, lambda data: b"\x55" * 20):
        assert main(["board", "show", f"serial:{line.path}"]) == 2
    assert "bytes came, which are no words of one" in capsys.readouterr().err


def test_a_board_is_not_flashed_while_another_program_has_its_line(
    line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    put_avrdude(tmp_path / "bin", f"touch {tmp_path}/called", monkeypatch)
    script = f"import sys; line = open({str(line.path)!r}, 'rb'); print(); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout and holder.stdin
        holder.stdout.readline()
        assert main(["board", "flash", "motor", f"serial:{line.path}"]) == 2
        holder.stdin.close()
    told = capsys.readouterr().err
    assert f"(process {holder.pid}) has the line; end it first" in told
    assert not (tmp_path / "called").exists()


def test_what_is_silent_is_told_nothing_and_named(
    line: Line, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agribot.drivers.probe.board_probe.BoardProbe.ask.__defaults__", (0.5,))
    with living(line, lambda data: b"") as heard:
        assert main(["board", "show", f"serial:{line.path}"]) == 2
    assert "no board of ours speaks there" in capsys.readouterr().err
    assert b"".join(heard) == b""


def put_avrdude(folder: Path, script: str, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.mkdir()
    (folder / "avrdude").write_text(f"#!/bin/sh\n{script}\n")
    (folder / "avrdude").chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")


@pytest.mark.parametrize("kind", ["motor", "imu"])
def test_avrdude_gets_the_built_program_and_the_board_is_asked_what_it_is_now(
    kind: str, line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    called = tmp_path / "called"
    put_avrdude(tmp_path / "bin", f'echo "$@" > {called}', monkeypatch)
    board = BoardEmulator()

    def live(data: bytes) -> bytes:
        board.feed(data)
        return board.advance()

    with living(line, live if kind == "motor" else LinesThenFrames().live):
        assert main(["board", "flash", kind, f"serial:{line.path}"]) == 0
    words = called.read_text().split()
    assert words[words.index("-P") + 1] == str(line.path) and "wiring" in words
    _, _, program = words[-1].split(":")[:3]
    assert Path(program).name == f"{kind}_board.hex" and Path(program).read_text().startswith(":")
    assert f"{kind} board, firmware" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("script", "why"),
    [
        ("", "sudo apt install avrdude"),
        ("echo no sync >&2; exit 1", "no sync"),
        (r"printf 'caf\351\n' >&2; exit 1", "caf\ufffd"),
    ],
)
def test_a_board_that_cannot_be_flashed_is_told_in_one_line(
    script: str, why: str, line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    if script:
        put_avrdude(tmp_path / "bin", script, monkeypatch)
    else:
        monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["board", "flash", "motor", f"serial:{line.path}"]) == 2
    assert why in capsys.readouterr().err.strip().splitlines()[-1]
