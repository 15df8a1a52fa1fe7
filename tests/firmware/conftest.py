"""A board on the bench; the bench is compiled once for a session."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from firmware.bench.avr_bench import AvrBench, build_library, load_library
from firmware.build import BOOTLOADER, PREBUILT
from tests import machine
from tests.firmware.board_on_bench import BoardOnBench


@pytest.fixture(scope="session")
def bench_library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    machine.require("simavr")
    return load_library(build_library(tmp_path_factory.mktemp("bench")))


@pytest.fixture(scope="session")
def bootloader() -> Path:
    """What a Mega is sold with."""
    if not BOOTLOADER.is_file():
        pytest.skip("the bootloader is missing (apt-get install arduino-core-avr)")
    return BOOTLOADER


@pytest.fixture
def make_board(bench_library: ctypes.CDLL) -> Iterator[Callable[..., BoardOnBench]]:
    boards: list[BoardOnBench] = []

    def make(**plant: float) -> BoardOnBench:
        bench = AvrBench(bench_library, PREBUILT / "motor_board.hex")
        boards.append(BoardOnBench(bench, **plant))
        return boards[-1]

    yield make
    for board in boards:
        board.bench.close()


@pytest.fixture
def board(make_board: Callable[..., BoardOnBench]) -> BoardOnBench:
    """A motor board that was just switched on, with motors that answer within 0.1 s."""
    return make_board()
