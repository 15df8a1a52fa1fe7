"""Boards that are asked over a slow line that loses, adds and cuts bytes: what they report is true.

Every report is compared with what the board did within the last half second. The right side turns
by other speeds than the left one and from another place, so that an answer to another question
shows.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from agribot.core.messages import (
    BoardSample,
    ClearStop,
    Four,
    ImplementCommand,
    ImuSample,
    RequestEvent,
)
from agribot.drivers.board.board_link import BoardLink
from agribot.drivers.board.motor_board import STATE_S
from agribot.drivers.board.odrive_line import PATIENCE_S
from agribot.drivers.imu.imu_devices import make_imu
from agribot.drivers.line.schemes import read_uri
from agribot.drivers.line.uri_options import UriOptions
from tests import nightly
from tests.asking import ask
from tests.drivers.esc_fakes import CLOSED_LOOP
from tests.drivers.hostile_line import HostileLine, Hostility
from tests.drivers.hostile_peers import (
    GYRO_RADPS2,
    KINDS,
    ROBOT,
    SERIAL,
    IdlePeer,
    ImuBoard,
    Kind,
    OdrivePeer,
    PlainOdrive,
)

TICK_S = 0.02
STILL = ImplementCommand()
SPEEDS: Four = (3.0, -2.0, 3.0, -2.0)
FAULT_S, WELL_S, END_S = 2.5, 4.0, 5.5  # a fault comes and goes, and the drive ends
PAUSES_S = (1.0, 2.2), (2.45, 3.4), (4.2, 5.0)
SLACK_RAD = 0.01  # a step of an encoder or tachometer


class Truth(NamedTuple):
    """What a board did at a moment: turns of right and left in rad, and whether it has a fault."""

    t_s: float
    turned_rad: tuple[float, float]
    has_fault: bool


class Drive:
    """Drives a board for a while, and compares each report with the truth of its time."""

    def __init__(self, kind: Kind, line: Hostility, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.now_s, self._kind = 0.0, kind
        self.peer = kind.make_peer()
        self.link = BoardLink(kind.make_board(lambda: self.now_s), ROBOT.drive, lambda: self.now_s)
        self._there = HostileLine(line, rng, has_strays=False)
        self._back = HostileLine(line, rng, has_strays=True)
        self._truth: list[Truth] = []
        self.wheels_s: list[float] = []
        self.events: tuple[RequestEvent, ...] = ()
        self.told_s = self.well_s = math.inf  # when the fault was first reported, and its end
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
            told = self.link.take(self.now_s)
            self._check(told)
            speeds = SPEEDS if self.now_s > 0.5 else (0.0,) * 4
            asked = self.link.clear(self.now_s, self.events, told["board"])
            asked += self.link.board.poll() + self.link.board.drive(speeds, STILL)
            self.events = ()
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
        has_fault = board.fault is not None or board.is_button_pressed
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
@pytest.mark.parametrize("name", ["odrive", "vesc", "agribot"])
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
        assert gaps_s.max() <= PATIENCE_S + 3.0 * (latency_s + TICK_S)
        assert drive.told_s - FAULT_S <= 0.1 + 3.0 * (latency_s + TICK_S)


def test_an_odrive_is_armed_over_a_hostile_line_and_no_axis_lets_go_again() -> None:
    clear = ask(ClearStop(), "Ann")
    for seed in range(4):
        drive = Drive(KINDS["odrive"]._replace(make_peer=IdlePeer), SERIAL, seed).run(1.0)
        assert isinstance(drive.peer, IdlePeer)
        fake = drive.peer.fake
        drive.events = (clear,)
        drive.run(2.5)
        assert fake.states == [CLOSED_LOOP, CLOSED_LOOP]
        assert sorted(fake.lets_go) == [0, 1], f"seed {seed}"


def test_rates_of_an_imu_board_over_a_hostile_line_are_those_of_their_time() -> None:
    device, peer, rng = (
        make_imu(UriOptions(read_uri("--source", "serial:/dev/x?board=agribot")), pytest.fail),
        ImuBoard(),
        np.random.default_rng(3),
    )
    there = HostileLine(SERIAL, rng, has_strays=False)
    back = HostileLine(SERIAL, rng, has_strays=True)
    told: list[float] = []
    now_s = 0.0
    device.open(now_s)
    while now_s < 8.0:
        now_s += TICK_S
        back.send(peer.advance(TICK_S), now_s, TICK_S)
        for piece in there.take(now_s):
            peer.hear(piece)
        for piece in (*back.take(now_s), b""):
            for stamp_s, sample in device.feed(piece, now_s):
                assert isinstance(sample, ImuSample)
                assert sample.gyro_radps[2] == pytest.approx(GYRO_RADPS2 * stamp_s, abs=2e-3)
                told.append(stamp_s)
            there.send(device.take_to_send(), now_s, TICK_S)
    assert len(told) > 200 and max(np.diff(told)) < 0.2
