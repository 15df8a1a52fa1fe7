"""Boards that are asked over a slow line that loses, adds and cuts bytes: what they report is true.

Every report is compared with what the board did within the last half second. The right side turns
by other speeds than the left one and from another place, so that an answer to another question
shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
import pytest

from agribot.core.messages import BoardSample, Four, ImplementCommand
from agribot.description.loader import load_robot
from agribot.drivers import board_kinds
from agribot.drivers.board_link import BoardLink
from agribot.drivers.can_frames import FRAME, CanFrame
from agribot.drivers.motor_board import STATE_S, MotorBoard
from agribot.drivers.odrive import OdriveBoard
from agribot.drivers.odrive_can import OdriveCanBoard
from agribot.drivers.vesc import LOCAL, VescBoard
from agribot.drivers.vesc_can import VescCanBoard
from tests import nightly
from tests.drivers.board_emulator import TICK_S as BOARD_TICK_S
from tests.drivers.board_emulator import BoardEmulator
from tests.drivers.can_fakes import FakeOdriveBus, FakeVescBus
from tests.drivers.esc_fakes import CLOSED_LOOP, FakeOdrive, FakeVesc
from tests.drivers.hostile_line import HostileLine, Hostility

TICK_S = 0.02
ROBOT = load_robot()
STILL = ImplementCommand()
SPEEDS: Four = (3.0, -2.0, 3.0, -2.0)
FAULT_S, WELL_S, END_S = 2.5, 4.0, 5.5  # a fault comes and goes, and the drive ends
PAUSES_S = (1.0, 2.2), (2.45, 3.4), (4.2, 5.0)
SLACK_RAD = 0.01  # a step of an encoder or tachometer
Clock = Callable[[], float]


class Truth(NamedTuple):
    """What a board did at a moment: turns of right and left in rad, and whether it has a fault."""

    t_s: float
    turned_rad: tuple[float, float]
    has_fault: bool


class Peer(Protocol):
    """A board at the other end of the line."""

    def advance(self, dt_s: float) -> bytes: ...
    def hear(self, data: bytes) -> bytes: ...
    def set_fault(self, *, is_there: bool) -> None: ...
    def turned_rad(self) -> tuple[float, float]: ...


class OdrivePeer:
    """Its left axis has the fault, the other one goes on."""

    def __init__(self, fake: FakeOdrive) -> None:
        self.fake = fake
        fake.states, fake._turns = [CLOSED_LOOP, CLOSED_LOOP], [1000.0, -500.0]
        fake.timeouts_s = [math.inf, math.inf]  # of the watchdogs, which others test

    def advance(self, dt_s: float) -> bytes:
        self.fake._left_s = [math.inf, math.inf]
        self.fake.advance(dt_s)
        return b""

    def hear(self, data: bytes) -> bytes:
        return self.fake.answer(data)

    def set_fault(self, *, is_there: bool) -> None:
        self.fake.errors[1] = 0x40 if is_there else 0
        self.fake.states[1] = 1 if is_there else CLOSED_LOOP

    def turned_rad(self) -> tuple[float, float]:
        right, left = (turns * math.tau / 10.0 for turns in self.fake._turns)
        return right, left


class PlainOdrive(FakeOdrive):
    """One whose answers have no checksums."""

    @staticmethod
    def _reply(text: str, *, has_checksum: bool) -> bytes:
        return f"{text}\r\n".encode() if text else b""


class VescPeer:
    """Tachometers begin at zero, as the codec counts them."""

    def __init__(self, fake: FakeVesc, left: int) -> None:
        self.fake, self._left = fake, left

    def advance(self, dt_s: float) -> bytes:
        self.fake.advance(dt_s)
        return b""

    def hear(self, data: bytes) -> bytes:
        return self.fake.answer(data)

    def set_fault(self, *, is_there: bool) -> None:
        self.fake.faults[self._left] = 9 if is_there else 0

    def turned_rad(self) -> tuple[float, float]:
        right, left = (steps * math.tau / 6.0 / 70.0 for steps in self.fake._steps.values())
        return right, left


class OurPeer:
    """The board of `firmware/`, whose fault is its red button."""

    def __init__(self) -> None:
        self.fake = BoardEmulator(timeout_s=math.inf)

    def advance(self, dt_s: float) -> bytes:
        return b"".join(self.fake.advance() for _ in range(round(dt_s / BOARD_TICK_S)))

    def hear(self, data: bytes) -> bytes:
        self.fake.feed(data)
        return b""

    def set_fault(self, *, is_there: bool) -> None:
        self.fake.is_button_pressed = is_there

    def turned_rad(self) -> tuple[float, float]:
        right, left, *_ = (count * math.tau / 4096.0 for count in self.fake._counts)
        return right, left


def make_ours(now_s: Clock) -> MotorBoard:
    motors = {"counts_per_turn": 4096.0, "full_speed_radps": 40.0}
    return board_kinds.open_board("tcp://localhost:1?board=agribot", ROBOT, motors).board


SERIAL = Hostility(loss_ratio=2e-4, stray_hz=1.0, strays=(
    b"unknown command\r\n", b"invalid property\r\n", b"8\r\n", b"\xff\x00*", b"\r\n", b"0.25 ",
    b"\x02\x1a\x32\x00\x00", b"0 *7",
))  # fmt: skip
BUS = Hostility(
    loss_ratio=0.02, stray_hz=5.0, unit=FRAME.size,
    strays=(CanFrame(0x7E1, b"12345678").pack(), CanFrame(0x51, b"\x08\0\0\0\0\0\0\0").pack()),
)  # fmt: skip


class Kind(NamedTuple):
    """A board and its codec, the line between them, and the safety input of its fault."""

    make_board: Callable[[Clock], MotorBoard]
    make_peer: Callable[[], Peer]
    line: Hostility
    input: str = "motors"


KINDS = {
    "odrive": Kind(lambda now: OdriveBoard((0, 1), 10.0, now_s=now),
                   lambda: OdrivePeer(FakeOdrive()), SERIAL),
    "odrive_can": Kind(lambda now: OdriveCanBoard((0, 1), 10.0, "active_errors", now),
                       lambda: OdrivePeer(FakeOdriveBus()), BUS),
    "vesc": Kind(lambda now: VescBoard((LOCAL, 12), 7, 10.0, now),
                 lambda: VescPeer(FakeVesc(3, (12,), math.inf), 12), SERIAL),
    "vesc_can": Kind(lambda now: VescCanBoard((11, 12), 7, 10.0, now),
                     lambda: VescPeer(FakeVescBus((11, 12), math.inf), 12), BUS, ""),
    "agribot": Kind(make_ours, OurPeer, SERIAL, "red button"),
}  # fmt: skip


class Drive:
    """A board is driven for a while; whatever is told is held against the truth of its time."""

    def __init__(self, kind: Kind, line: Hostility, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.now_s, self._kind = 0.0, kind
        self.peer = kind.make_peer()
        self.link = BoardLink(kind.make_board(lambda: self.now_s), ROBOT.drive, lambda: self.now_s)
        self._there = HostileLine(line, rng, has_strays=False)
        self._back = HostileLine(line, rng, has_strays=True)
        self._truth: list[Truth] = []
        self.wheels_s: list[float] = []
        self.told_s = self.well_s = math.inf  # when the fault was first told, and its end
        self._there.send(self.link.open(), 0.0, TICK_S)

    def run(self, until_s: float) -> Drive:
        while self.now_s < until_s:
            self.now_s += TICK_S
            has_fault = FAULT_S <= self.now_s < WELL_S
            self.peer.set_fault(is_there=has_fault)
            said = self.peer.advance(TICK_S)
            for piece in self._there.take(self.now_s):
                said += self.peer.hear(piece)
            self._back.send(said, self.now_s, TICK_S)
            self._truth.append(Truth(self.now_s, self.peer.turned_rad(), has_fault))
            for piece in self._back.take(self.now_s):
                self.link.feed(piece, self.now_s)
            self._check(self.link.take(self.now_s))
            speeds = SPEEDS if self.now_s > 0.5 else (0.0,) * 4
            asked = self.link.board.poll() + self.link.board.drive(speeds, STILL)
            self._there.send(asked, self.now_s, TICK_S)
        return self

    def _check(self, told: dict[str, tuple[Any, ...]]) -> None:
        for wheels in told["wheels"]:
            self.wheels_s.append(wheels.t_s)
            for side in (0, 1):
                turned_rad = [truth.turned_rad[side] for truth in self._find_truth(wheels.t_s)]
                low_rad, high_rad = min(turned_rad) - SLACK_RAD, max(turned_rad) + SLACK_RAD
                assert low_rad <= wheels.angle_rad[side] <= high_rad, f"at {wheels.t_s:.2f} s"
        for battery in told["battery"]:
            assert 24.0 < battery.voltage_v < 26.0
        for board in told["board"]:
            if self._kind.input in board.inputs:
                self._check_fault(board)

    def _check_fault(self, board: BoardSample) -> None:
        has_fault = bool(board.faults) or board.is_button_pressed
        was_so = {truth.has_fault for truth in self._find_truth(board.t_s)}
        assert has_fault in was_so, f"at {board.t_s:.2f} s"
        if has_fault:
            self.told_s = min(self.told_s, self.now_s)
        elif self.told_s < math.inf:
            self.well_s = min(self.well_s, self.now_s)

    def _find_truth(self, t_s: float) -> list[Truth]:
        """Find what was true within the age that a state may have, and in the tick around it."""
        from_s, until_s = t_s - STATE_S - TICK_S, t_s + TICK_S
        return [truth for truth in self._truth[-500:] if from_s <= truth.t_s <= until_s]


@nightly.all_or_first("seeds", range(100), 4)
@pytest.mark.parametrize("name", KINDS)
def test_what_a_board_reports_over_a_hostile_line_was_true_within_the_last_half_second(
    name: str, seeds: range
) -> None:
    kind = KINDS[name]
    for seed in seeds:
        drive = Drive(kind, kind.line, seed).run(END_S)
        assert len(drive.wheels_s) > 4.0 * END_S
        if kind.input:
            assert drive.told_s - FAULT_S <= STATE_S, f"seed {seed}"
            assert drive.well_s - WELL_S <= STATE_S, f"seed {seed}"


@nightly.all_or_first("seeds", range(100), 4)
@pytest.mark.parametrize("name", ["odrive", "agribot"])
def test_answers_that_a_line_held_back_are_not_reported_as_new(name: str, seeds: range) -> None:
    kind = KINDS[name]
    for seed in seeds:
        drive = Drive(kind, kind.line._replace(pauses_s=PAUSES_S), seed).run(END_S + 1.0)
        assert drive.wheels_s[-1] > PAUSES_S[-1][1] + 0.1


@pytest.mark.parametrize("latency_s", [0.002, 0.016, 0.021, 0.03, 0.06, 0.1])
def test_an_odrive_is_understood_again_after_a_stray_line_at_any_delay(latency_s: float) -> None:
    calm = Hostility(latency_s, jitter_s=0.001, stray_hz=1.0, strays=(b"unknown command\r\n",))
    kinds = KINDS["odrive"], KINDS["odrive"]._replace(make_peer=lambda: OdrivePeer(PlainOdrive()))
    for seed, kind in enumerate(kinds):
        drive = Drive(kind, calm, seed).run(END_S)
        gaps_s = np.diff(drive.wheels_s)
        assert gaps_s.max() <= 2.0 * (latency_s + 3.0 * TICK_S)
        assert drive.told_s - FAULT_S <= 0.1 + 3.0 * (latency_s + TICK_S)
