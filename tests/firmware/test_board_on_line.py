"""A program that opens a serial line drives the firmware behind it, as it would a real board."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from agribot.core.facts import BoardHung, BoardStopped, Fact
from agribot.core.messages import (
    ClearStop,
    DriveCommand,
    RobotCommand,
    SensorBatch,
)
from agribot.description.loader import load_robot
from agribot.drivers.board.board_codec import BoardDecoder, BoardEncoder
from agribot.drivers.board.board_kinds import open_board
from agribot.drivers.board.board_protocol import BAUD, BoardMessage, BoardState, ClearLatch
from agribot.drivers.hardware_platform import HardwarePlatform
from agribot.drivers.line.byte_streams import ByteStream, SerialStream
from firmware.bench.avr_bench import AvrBench
from firmware.bench.board_on_line import BoardOnLine, main, name_source
from firmware.build import PREBUILT
from tests import nightly
from tests.finding import holds
from tests.firmware.board_on_bench import REST, command, configure
from tests.waiting import wait_for

FORWARD = (4.0, 4.0, 4.0, 4.0)


@pytest.mark.parametrize(("words", "status"), [(["--help"], 0), (["imus"], 2)])
def test_no_board_is_started_for_help_or_for_a_board_that_there_is_not(
    words: list[str], status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == status
    assert "usage: python -m firmware.bench.board_on_line" in "".join(capsys.readouterr())


def test_a_program_drives_the_board_over_a_serial_line(bench_library: ctypes.CDLL) -> None:
    bench = AvrBench(bench_library, PREBUILT / "motor_board.hex")
    encoder, decoder = BoardEncoder(), BoardDecoder()
    states: list[BoardState] = []
    with BoardOnLine(bench) as board:
        stream = SerialStream(board.path, BAUD)

        def exchange(*messages: BoardMessage) -> BoardState | None:
            stream.write(b"".join(encoder.encode(message)[1] for message in messages))
            found = [frame.message for frame in decoder.feed(stream.read())]
            states.extend(message for message in found if isinstance(message, BoardState))
            return states[-1] if states else None

        wait_for(exchange, "a state of the board")
        exchange(configure(), ClearLatch())
        wait_for(lambda: not getattr(exchange(command(REST)), "flags", True), "no flags")
        wait_for(
            lambda: min(getattr(exchange(command(FORWARD)), "counts", REST)) > 100, "wheels to turn"
        )
        stream.close()
    assert (decoder.bad, decoder.unknown) == (0, 0)
    bench.close()


ROBOT = load_robot()
COMES_UP_S = 20.0  # of the board's time; a bootloader that took a byte gives up after five
STANDS_S = 0.5  # after a stop: a board that was cleared waits for a speed of zero


class Mega:
    """A Mega as it is sold, on a line that keeps its name; opening the line resets the board."""

    def __init__(self, library: ctypes.CDLL, bootloader: Path, folder: Path) -> None:
        self.bench = AvrBench(library, PREBUILT / "motor_board.hex", bootloader=bootloader)
        self._path = folder / "ttyBASE"
        self.line = self.plug_in()

    def plug_in(self) -> BoardOnLine:
        self.line = BoardOnLine(self.bench)
        self._path.unlink(missing_ok=True)
        self._path.symlink_to(self.line.path)
        return self.line.__enter__()

    def open(self) -> ByteStream:
        return SerialStream(str(self._path), BAUD)


class Driver:
    """The robot's side: a platform that reads and commands 50 times a second."""

    def __init__(self, mega: Mega) -> None:
        self._mega, self._stopped_s = mega, 0.0
        options = "counts_per_turn=2048&full_speed_radps=30"
        board = open_board(f"serial:{BAUD}?{options}", ROBOT).board
        self.platform = HardwarePlatform(
            ROBOT, 50.0, board, mega.open, "the test", lambda: mega.bench.t_s
        )

    def drive_until(self, is_so: Callable[[SensorBatch], object]) -> SensorBatch:
        """Drive forwards; a person clears every stop."""
        from_s = self._mega.bench.t_s

        def exchange() -> SensorBatch | None:
            batch = self.platform.read()
            if batch.board and batch.board[-1].stop:
                self._stopped_s = batch.t_s
                self.platform.inbox.post(ClearStop())
            may_drive = batch.t_s > self._stopped_s + STANDS_S
            drive = DriveCommand(v_mps=0.3 if may_drive else 0.0, yaw_rate_radps=0.0)
            self.platform.write(RobotCommand(t_s=batch.t_s, drive=drive))
            assert self._mega.bench.t_s - from_s < COMES_UP_S, "the board does not come up"
            return batch if is_so(batch) else None

        return wait_for(exchange, "the board")


def test_what_the_bench_prints_is_a_board_that_a_robot_takes() -> None:
    assert open_board(name_source("/dev/pts/3", is_imu=False), ROBOT).name == "/dev/pts/3"
    assert name_source("/dev/pts/3", is_imu=True) == "serial:/dev/pts/3"


@pytest.fixture
def mega(bench_library: ctypes.CDLL, bootloader: Path, tmp_path: Path) -> Iterator[Mega]:
    pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")
    mega = Mega(bench_library, bootloader, tmp_path)
    yield mega
    mega.line.unplug()
    mega.bench.close()


def turns(batch: SensorBatch) -> bool:
    """All four do, also the one of whose encoder the bootloader takes a pin for its lamp."""
    return bool(batch.wheels) and min(batch.wheels[-1].speed_radps) > 1.0


def tells(batch: SensorBatch, why: Fact) -> bool:
    return any(holds(board.stop, why) or holds(board.fault, why) for board in batch.board)


def plug_in_anew(mega: Mega) -> None:
    mega.line.unplug()
    mega.plug_in()


@pytest.mark.parametrize(
    ("harm", "why"),
    [
        (plug_in_anew, BoardStopped(("began",))),
        pytest.param(
            lambda mega: mega.line.do(mega.bench.reset),
            BoardStopped(("began",)),
            marks=nightly.by_day(
                "tests/firmware/test_motor_board.py::test_behind_the_bootloader_of_a_mega_it_tells"
                "_a_reset_by_its_watchdog_from_one_by_its_button"
            ),
        ),
        (lambda mega: mega.line.do(mega.bench.hang), BoardHung()),
    ],
    ids=["plugged in anew", "reset by its button", "hung"],
)
def test_a_board_behind_the_bootloader_of_a_mega_comes_up_and_does_again_whatever_befalls_it(
    harm: Callable[[Mega], None], why: Fact, mega: Mega
) -> None:
    driver = Driver(mega)
    try:
        driver.drive_until(turns)
        harm(mega)
        driver.drive_until(lambda batch: tells(batch, why))
        driver.drive_until(turns)
    finally:
        driver.platform.close()
