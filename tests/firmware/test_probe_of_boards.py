"""The real programs of both boards, behind a Mega's bootloader, identify themselves to a probe."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.core.fact_text import render
from agribot.core.facts import BoardStopped
from agribot.drivers.line.byte_streams import SerialStream
from agribot.drivers.probe.line_answers import LineAnswer
from agribot.drivers.probe.line_probe import LineProbe, order_bauds
from firmware.bench.avr_bench import AvrBench
from firmware.bench.board_on_line import BoardOnLine
from firmware.build import PREBUILT

pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")


@pytest.fixture
def bench(
    request: pytest.FixtureRequest, bench_library: ctypes.CDLL, bootloader: Path
) -> Iterator[AvrBench]:
    bench = AvrBench(bench_library, PREBUILT / f"{request.param}.hex", bootloader=bootloader)
    yield bench
    bench.close()


def probe(bench: AvrBench) -> LineAnswer:
    """Probe the board by its own clock, however slow this machine is."""
    bauds = order_bauds("Arduino Mega 2560")
    with BoardOnLine(bench) as board:
        line = SerialStream(board.path, bauds[0])
        try:
            return LineProbe(line, lambda: bench.t_s).find(bauds)
        finally:
            line.close()


@pytest.mark.parametrize("bench", ["motor_board"], indirect=True)
def test_the_motor_board_tells_version_flags_and_battery(bench: AvrBench) -> None:
    answer = probe(bench)
    assert (answer.kind, answer.use, answer.is_good) == ("motor board", "base", True)
    assert {"NOT_CONFIGURED", "STOP_LATCHED"} <= set(answer.numbers["flags"])
    assert render(BoardStopped(("began",))) in answer.detail
    assert answer.numbers["battery_v"] > 0.0
    assert not any(bench.duty_ratio), "no wheel is driven"


@pytest.mark.parametrize("bench", ["imu_board"], indirect=True)
def test_the_imu_board_prints_lines_and_is_known_by_its_answer(bench: AvrBench) -> None:
    bench.set_imu((0.0, 0.0, 9.81), (0.0, 0.0, 0.0))
    answer = probe(bench)
    assert (answer.kind, answer.use, answer.is_good) == ("imu board", "imu", True)
    assert answer.options == (("board", "agribot"),)
    assert "9.8" in answer.detail
