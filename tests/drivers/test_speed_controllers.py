"""Motor controllers of other makers behind a link, as a robot has them: armed, driven, stopped.

Nothing here waits: their time passes with the commands.
"""

from __future__ import annotations

import math
import queue
import struct
from itertools import count

import pytest

from agribot.core.facts import AxisError, AxisStands, Both, ControllerFault, LineNoisy
from agribot.core.messages import (
    BoardSample,
    ClearStop,
    DeviceNote,
    DriveCommand,
    RequestEvent,
    RobotCommand,
)
from agribot.description.loader import load_robot
from agribot.drivers.board import board_kinds, odrive, vesc, vesc_packets
from agribot.drivers.board.board_link import BoardLink
from agribot.drivers.board.motor_board import BoardReport, MotorBoard
from agribot.drivers.hardware_platform import HardwarePlatform
from tests.asking import ask
from tests.drivers.esc_fakes import CLOSED_LOOP, IDLE, FakeOdrive, FakeVesc

ROBOT = load_robot()
TICK_S = 0.02
CLEAR = ask(ClearStop(), "Ann")
BOTH_IDLE = Both(*(AxisStands("axis", axis, "idle", IDLE) for axis in "01"))
AHEAD, STAND = (
    RobotCommand(t_s=0.0, drive=DriveCommand(v_mps=v, yaw_rate_radps=0.0)) for v in (0.3, 0.0)
)
WHEEL_RADPS = 0.3 / ROBOT.drive.wheel_radius_m
ODRIVE, VESC = "board=odrive&gear=10", "board=vesc&ids=local,11,12,13&pole_pairs=7&gear=10"
BYTES_PER_S, MOST_HZ = 115_200 / 10, 100  # of the line; the shortest tick that a robot may have


def open_board(options: str) -> MotorBoard:
    return board_kinds.open_board(f"tcp://localhost:1?{options}", ROBOT).board


class Linked:
    """A board behind its link; `told` has its reports since it was last emptied."""

    def __init__(
        self, fake: FakeOdrive | FakeVesc, options: str = ODRIVE, board: MotorBoard | None = None
    ) -> None:
        self.fake, self.now_s = fake, 0.0
        board = board or open_board(options)
        self.link = BoardLink(board, ROBOT.drive, lambda: self.now_s)
        self.told: list[BoardSample] = []
        self.speeds: list[tuple[float, ...]] = []
        self.sizes: list[tuple[int, int]] = []
        self.plug_in()

    def plug_in(self) -> None:
        self.link.feed(self.fake.answer(self.link.board.open()), self.now_s)

    def run(self, seconds: float, command: RobotCommand | None = STAND, *events: RequestEvent,
            loses: slice = slice(None)) -> Linked:  # fmt: skip
        """Let ticks pass; without a command no wheel turns. `loses` is the part kept of answers."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self.fake.advance(TICK_S)
            batch = self.link.take(self.now_s)
            self.told += batch["board"]
            self.speeds += [wheels.speed_radps for wheels in batch["wheels"]]
            out = self.link.clear(self.now_s, events, batch["board"])
            out += self.link.command(command) if command else b""
            said = self.fake.answer(out)
            self.sizes.append((len(out), len(said)))
            self.link.feed(said[loses], self.now_s)
            events = ()
        return self

    def is_well(self) -> bool:
        """Whether the board reports neither a stop nor a fault."""
        return self.last.stop is None and self.last.fault is None

    @property
    def last(self) -> BoardSample:
        return self.told[-1]


def test_an_odrive_stands_until_a_person_clears_its_stop_and_drives_then() -> None:
    fake = FakeOdrive()
    linked = Linked(fake).run(1.0, AHEAD)
    assert linked.last.stop == BOTH_IDLE
    assert (linked.last.fault, fake.states, fake.speed(0)) == (None, [IDLE, IDLE], 0.0)
    linked.run(6.0, AHEAD, CLEAR)
    assert linked.is_well()
    assert fake.states == [CLOSED_LOOP, CLOSED_LOOP]
    assert linked.speeds[-1] == pytest.approx([WHEEL_RADPS] * 4, rel=0.01)


def test_the_watchdogs_of_an_odrive_stop_a_robot_that_nobody_drives_and_a_person_goes_on() -> None:
    fake = FakeOdrive()
    linked = Linked(fake).run(1.0, STAND, CLEAR).run(1.0, AHEAD)
    assert fake.watchdogs == {0, 1} and fake.speed(0) > 0.0
    linked.run(odrive.WATCHDOG_S + TICK_S, None)
    assert fake.states == [IDLE, IDLE] and fake.errors == [0x800, 0x800]
    linked.run(0.5, STAND)
    assert linked.last.stop == Both(*(AxisStands("axis", axis, "error", IDLE) for axis in "01"))
    expired = [AxisError("axis", axis, 0x800, is_expired=True) for axis in "01"]
    assert linked.last.fault == Both(*expired)
    linked.run(1.0, AHEAD, CLEAR)
    assert linked.is_well()
    assert fake.speed(1) > 0.0


def test_an_odrive_that_was_on_while_the_robots_program_began_anew_is_cleared_likewise() -> None:
    fake = FakeOdrive()
    Linked(fake).run(1.0, AHEAD, CLEAR)
    fake.advance(60.0)
    again = Linked(fake).run(0.5)
    assert again.last.fault and again.last.stop
    again.run(0.5, STAND, CLEAR)
    assert again.is_well() and fake.states == [CLOSED_LOOP, CLOSED_LOOP]


def test_an_odrive_that_restarted_stands_and_its_watchdogs_are_switched_on_again() -> None:
    fake = FakeOdrive()
    linked = Linked(fake).run(1.0, AHEAD, CLEAR)
    fake.restart()
    linked.run(0.5, AHEAD)
    assert fake.watchdogs == {0, 1} and fake.errors == [0, 0]
    assert linked.last.stop == BOTH_IDLE
    assert fake.speed(0) == 0.0


def test_one_axis_with_an_error_is_told_with_its_wheels_and_the_other_stays_in_closed_loop() -> (
    None
):
    fake = FakeOdrive()
    linked = Linked(fake, "board=odrive&axes=1,0&gear=10").run(1.0, AHEAD, CLEAR)
    fake.errors[0] = 0x40
    linked.run(0.5, AHEAD)
    assert linked.last.fault == AxisError("axis", "0", 0x40, is_expired=False)
    assert isinstance(linked.last.stop, AxisStands)
    assert (linked.last.stop.axis, linked.last.stop.why) == ("0", "error")
    fake.lets_go.clear()
    linked.run(0.5, AHEAD, CLEAR)
    assert linked.last.stop is None and fake.lets_go == [0]


def test_an_error_that_comes_back_is_not_cleared_for_ever() -> None:
    fake = FakeOdrive()
    linked = Linked(fake).run(1.0, AHEAD)
    fake.is_broken = True
    linked.run(5.0, AHEAD, CLEAR)
    assert linked.last.fault and linked.last.stop
    clears = fake.clears
    assert 1 < clears < 2.5 / TICK_S
    linked.run(3.0, AHEAD)
    assert fake.clears == clears


def test_an_odrive_tells_positions_speeds_and_voltage_of_both_sides() -> None:
    driver, fake = open_board("board=odrive&axes=1,0&gear=10"), FakeOdrive()
    fake.states = [CLOSED_LOOP, CLOSED_LOOP]
    found = driver.feed(fake.answer(driver.open()))
    for _ in range(100):
        fake.advance(TICK_S)
        said = fake.answer(driver.poll() + driver.drive((2.0, -1.0, 2.0, -1.0), STAND.implement))
        found += driver.feed(said)
    report: BoardReport = found[-1].report
    assert report.wheels is not None and report.battery is not None
    assert report.wheels.speed_radps == pytest.approx((2.0, -1.0, 2.0, -1.0), rel=0.01)
    assert report.wheels.angle_rad == pytest.approx((4.0, -2.0, 4.0, -2.0), rel=0.02)
    assert report.battery.voltage_v == pytest.approx(24.3)


@pytest.mark.parametrize("loses", [slice(3, None), slice(0, -9), slice(0, 20), slice(24, None)])
def test_answers_of_an_odrive_that_got_lost_are_not_taken_for_others(loses: slice) -> None:
    fake = FakeOdrive()
    linked = Linked(fake).run(1.0, AHEAD, CLEAR)
    linked.told.clear()
    for _ in range(30):
        linked.run(TICK_S, AHEAD, loses=loses).run(0.14, AHEAD)
    assert {(told.stop, told.fault) for told in linked.told} == {(None, None)}
    assert all(
        speeds == pytest.approx([WHEEL_RADPS] * 4, rel=0.01) for speeds in linked.speeds[-9:]
    )


def test_a_number_of_an_odrive_that_lost_a_digit_is_left_out_and_counted() -> None:
    fake, board = FakeOdrive(), odrive.OdriveBoard((0, 1), 10.0, now_s=lambda: 0.0)
    fake._turns = [123.0, 45.0]
    board.feed(fake.answer(board.open() + board.poll()))
    said = fake.answer(board.poll())
    assert board.feed(said.replace(b"123.", b"13.")) == [] and board.broken == 1
    (found,) = board.feed(fake.answer(board.poll()))
    assert found.report.wheels is not None
    assert found.report.wheels.angle_rad[0] == pytest.approx(123.0 * math.tau / 10.0)


def test_a_speed_that_lost_its_point_on_the_way_to_an_odrive_drives_nothing() -> None:
    fake, board = FakeOdrive(), open_board(ODRIVE)
    fake.states = [CLOSED_LOOP, CLOSED_LOOP]
    fake.answer(board.drive((1.0,) * 4, STAND.implement))
    fake.answer(board.drive((2.0,) * 4, STAND.implement).replace(b".", b""))
    assert fake.speed(0) == pytest.approx(10.0 / math.tau, rel=1e-4)


def test_a_line_to_an_odrive_that_breaks_answers_is_told() -> None:
    fake, now_s = FakeOdrive(), 0.0
    board = odrive.OdriveBoard((0, 1), 10.0, now_s=lambda: now_s)
    link, noted = BoardLink(board, ROBOT.drive, lambda: now_s), list[DeviceNote]()
    link.open()
    for tick in range(200):
        now_s += TICK_S
        said = fake.answer(link.command(STAND))
        link.feed(said[3:] if tick % 10 == 0 else said, now_s)
        noted += link.watch_line(now_s)
    (note,) = noted
    assert isinstance(note.fact, LineNoisy)
    assert (note.fact.device, note.fact.count) == ("board", 3)


def test_the_values_of_two_vescs_are_no_reading_where_one_of_them_is_old() -> None:
    fake, now_s = FakeVesc(local=3, others=(9,)), 0.0
    board = vesc.VescBoard((vesc.LOCAL, 9), 7, 10.0, lambda: now_s)
    asked = board.poll()
    right, left = (fake.answer(asked[at]) for at in (slice(0, 10), slice(10, None)))
    assert board.feed(right) == []
    now_s = 0.6
    assert board.feed(left) == []
    assert len(board.feed(right)) == 1


def test_of_readings_that_a_line_held_back_the_last_one_counts() -> None:
    fake = FakeVesc(local=3, others=(11, 12, 13))
    linked, held = Linked(fake, VESC).run(0.5, AHEAD), b""
    for command in (AHEAD, AHEAD, STAND, STAND):
        fake.faults[12] = 9 if command is STAND else 0
        fake.advance(TICK_S)
        held += fake.answer(linked.link.command(command))
    linked.now_s += 0.1
    linked.link.take(linked.now_s)
    linked.link.feed(held, linked.now_s)
    told = linked.link.take(linked.now_s + TICK_S)
    assert [wheels.speed_radps for wheels in told["wheels"]] == [(0.0,) * 4]
    (board,) = told["board"]
    assert isinstance(board.fault, ControllerFault)


class CommandedLine:
    """A line to a fake whose time passes with what is written to it, a tick a time."""

    def __init__(self, fake: FakeOdrive) -> None:
        self._fake, self._said = fake, queue.SimpleQueue[bytes]()

    def read(self) -> bytes:
        try:
            return self._said.get(timeout=0.05)
        except queue.Empty:
            return b""

    def write(self, data: bytes) -> None:
        self._fake.advance(TICK_S)
        self._said.put(self._fake.answer(data))

    def close(self) -> None:
        """There is nothing to close."""


def test_a_robot_with_an_odrive_is_armed_driven_and_stopped_as_its_program_ends() -> None:
    fake = FakeOdrive()
    line = CommandedLine(fake)
    platform = HardwarePlatform(ROBOT, MOST_HZ, open_board(ODRIVE), lambda: line, "fake")
    try:
        for tick in count():
            board = platform.read().board
            platform.write(AHEAD if tick > 50 else STAND)
            if tick == 30:
                platform.inbox.post(CLEAR.request)
            if tick > 60 and board and not board[-1].stop and fake.speed(0) > 0.0:
                break
            assert tick < 2000, (fake.states, fake.errors)
        assert board[-1].fault is None and fake.errors == [0, 0]
    finally:
        platform.close()
    assert fake.speed(0) == 0.0


def test_a_vesc_needs_no_arming_and_goes_on_after_a_silence() -> None:
    fake = FakeVesc(local=3, others=(11, 12, 13))
    linked = Linked(fake, VESC).run(0.5, AHEAD)
    assert linked.speeds[-1] == pytest.approx([WHEEL_RADPS] * 4, rel=0.01)
    linked.run(0.5, None)
    assert set(fake.erpm.values()) == {0}
    linked.run(0.5, AHEAD)
    assert linked.speeds[-1] == pytest.approx([WHEEL_RADPS] * 4, rel=0.01)
    assert {told.stop for told in linked.told} == {None}


@pytest.mark.parametrize("options", [ODRIVE, VESC])
def test_questions_commands_and_answers_of_the_fastest_tick_fit_the_line(options: str) -> None:
    fake = FakeOdrive() if options == ODRIVE else FakeVesc(local=3, others=(11, 12, 13))
    linked = Linked(fake, options).run(2.0, AHEAD, CLEAR)
    for way in zip(*linked.sizes, strict=True):
        assert 0.0 < sum(way) / len(way) * MOST_HZ < BYTES_PER_S


def test_a_vesc_is_asked_for_what_is_used_and_answers_in_26_bytes() -> None:
    fake, driver = FakeVesc(local=3, others=()), vesc.VescBoard((vesc.LOCAL, 9), 7, 10.0)
    said = fake.answer(driver.poll()[:10])
    assert len(said) == 26
    (payload,) = vesc_packets.VescDecoder().feed(said)
    assert struct.unpack(">BI", payload[:5]) == (50, 0b10_1010_0001_1000_1000)
    values = vesc_packets.read_values(payload)
    assert values == vesc_packets.VescValues(3, 0.0, 0, 24.6, 0.8, 0)
    assert vesc_packets.read_values(payload[:-1]) is None
    assert vesc_packets.read_values(payload[:4] + b"\0" + payload[5:]) is None
