"""The contactor's side of the gate: when the motors lose their power, and when it comes back."""

from __future__ import annotations

from typing import get_args
from unittest.mock import ANY

import msgspec
import pytest

from agribot.autonomy.control.hazards import CONTACTOR
from agribot.autonomy.control.power_cut import BLIND_S, OPENING_S, REST_S
from agribot.core.facts import (
    AnyFact,
    ButtonPressed,
    ContactorInTrouble,
    ContactorSilent,
    ContactorStaysOpen,
    ContactorWelded,
    Fact,
    MotorsUnpowered,
    NoContactor,
    RelayLost,
    Runaway,
    SensorSilent,
    Wheel,
    WheelsTurnUnpowered,
    WheelsWrong,
)
from agribot.core.messages import (
    STOP,
    BoardSample,
    ContactorSample,
    DriveCommand,
    MissionState,
    RequestWord,
    RobotCommand,
    SensorBatch,
)
from tests.autonomy.control.kinematic_rover import TICK_S
from tests.autonomy.control.test_supervisor import FORWARD, Gate
from tests.finding import holds

FULL = DriveCommand(v_mps=1.0)
TOO_FAST = WheelsWrong(get_args(Wheel), "fast", ANY, 0.0)
CUT = Runaway(ANY, is_cut=True, is_contactor_stuck=False)
BY_BUTTON = Runaway(ANY, is_cut=False, is_contactor_stuck=False)
STUCK = Runaway(ANY, is_cut=False, is_contactor_stuck=True)


class Machine:
    """A robot with a contactor that obeys; `wheels`, if not None, turn regardless of commands."""

    def __init__(self, *, has_contactor: bool = True) -> None:
        self.gate = Gate()
        self.has_contactor, self.is_closed, self.is_welded = has_contactor, True, False
        self.is_one_welded = False  # of two
        self.fault: AnyFact | None = None
        self.is_silent, self.are_wheels_seen = False, True
        self.wheels: DriveCommand | None = None
        self.button = False
        self.sent = RobotCommand(t_s=0.0)
        self.reason: Fact | None = None

    def go(
        self, seconds: float, drive: DriveCommand = FORWARD, *actions: RequestWord,
        state: MissionState = "running",
    ) -> RobotCommand:  # fmt: skip
        for tick in range(round(seconds / TICK_S)):
            batch = self.sense()
            acts = actions if tick == 0 else ()
            self.sent, self.reason = self.gate.send(
                drive,
                batch=batch,
                state=state,
                actions=acts,
            )
            self.is_closed = self.is_welded or not self.sent.is_power_cut
        return self.sent

    def sense(self) -> SensorBatch:
        rover = self.gate.rover
        if self.wheels is not None:
            rover.turn_wheels(self.wheels)
        batch = rover.batch()
        told = ContactorSample(
            t_s=batch.t_s, is_closed=self.is_closed, fault=self.fault,
            is_one_closed=self.is_one_welded and not self.is_closed,
        )  # fmt: skip
        board = BoardSample(t_s=batch.t_s, inputs=("red button",), is_button_pressed=self.button)
        return msgspec.structs.replace(
            batch, t_s=rover.t_s + TICK_S,
            contactor=(told,) if self.has_contactor and not self.is_silent else (),
            board=(board,), wheels=batch.wheels if self.are_wheels_seen else (),
        )  # fmt: skip

    @property
    def stopped(self) -> Fact | None:
        gate = self.gate.supervisor.gate
        return gate.fact if gate.state == "stopped" else None


@pytest.fixture
def machine() -> Machine:
    machine = Machine()
    machine.go(1.0)
    assert machine.sent.drive == FORWARD and not machine.sent.is_power_cut
    return machine


def run_away(machine: Machine, drive: DriveCommand = FULL) -> None:
    machine.wheels = drive
    machine.go(1.3)


def test_wheels_that_turn_on_though_they_are_to_stand_lose_their_power(machine: Machine) -> None:
    run_away(machine)
    assert machine.sent.is_power_cut
    assert machine.stopped and machine.sent.drive == STOP
    assert holds(machine.reason, CUT, TOO_FAST)


@pytest.mark.parametrize("state", ["waiting", "paused", "done", "failed"])
@pytest.mark.parametrize("is_stopped", [False, True])
def test_a_board_that_sets_off_while_the_robot_stands_is_cut_within_half_a_second_in_every_state(
    state: MissionState, is_stopped: bool
) -> None:
    machine = Machine()
    machine.go(1.0, STOP, state=state)
    machine.go(1.0, STOP, *(("stop",) if is_stopped else ()), state=state)
    machine.wheels = FULL
    machine.go(0.5, STOP, state=state)
    assert machine.sent.is_power_cut and machine.stopped
    assert holds(machine.reason, CUT, TOO_FAST)


@pytest.mark.parametrize("has_contactor", [False, True])
def test_a_paused_robot_is_pushed_freely_until_a_person_presses_stop(has_contactor: bool) -> None:
    machine = Machine(has_contactor=has_contactor)
    machine.go(1.0, STOP, state="paused")
    machine.wheels = DriveCommand(v_mps=0.25)
    machine.go(3.0, STOP, state="paused")
    assert not (machine.stopped or machine.reason or machine.sent.is_power_cut)
    machine.go(0.1, STOP, "stop", state="paused")
    assert machine.sent.is_power_cut is has_contactor
    assert holds(machine.reason, Runaway)


def test_a_runaway_in_a_pause_of_a_robot_without_a_contactor_stops_the_mission() -> None:
    machine = Machine(has_contactor=False)
    machine.go(1.0, STOP, state="paused")
    machine.wheels = FULL
    machine.go(0.5, STOP, state="paused")
    assert holds(machine.stopped, TOO_FAST)
    assert holds(machine.reason, BY_BUTTON)


def test_a_robot_without_a_contactor_is_told_of_the_red_button_and_cuts_nothing() -> None:
    machine = Machine(has_contactor=False)
    machine.go(1.0)
    run_away(machine)
    assert not machine.sent.is_power_cut
    assert holds(machine.reason, BY_BUTTON)


def test_a_board_that_obeys_its_stop_keeps_its_power_to_brake_with(machine: Machine) -> None:
    machine.wheels = FULL
    machine.go(0.7)
    assert machine.stopped, "too fast: the robot is stopped"
    machine.wheels = None
    machine.go(5.0)
    assert not machine.sent.is_power_cut


def test_the_power_comes_back_once_the_stop_is_cleared_and_all_wheels_stand(
    machine: Machine,
) -> None:
    run_away(machine)
    machine.wheels = DriveCommand(
        v_mps=0.05
    )  # it rolls out, slower than what is reported as running
    machine.go(0.5, STOP, state="paused")
    machine.go(0.5, STOP, "clear_stop", state="paused")
    assert machine.sent.is_power_cut
    assert holds(machine.stopped, WheelsTurnUnpowered)
    machine.wheels = None
    machine.go(2.0, STOP, state="paused")
    assert machine.sent.is_power_cut, "it stands, and the stop is not cleared"
    machine.go(REST_S + 0.5, STOP, "clear_stop", state="paused")
    assert not machine.stopped and not machine.sent.is_power_cut
    assert machine.go(1.0).drive == FORWARD


def test_a_wheel_that_people_push_while_the_power_is_off_keeps_it_off(machine: Machine) -> None:
    run_away(machine)
    machine.wheels = None
    machine.go(2.0, STOP, state="paused")  # it had stood: no wheel counts as driven any more
    machine.wheels = DriveCommand(v_mps=-0.3)
    machine.go(0.5, STOP, "clear_stop", state="paused")
    assert machine.sent.is_power_cut and machine.stopped


def test_no_command_passes_before_the_contactor_is_closed(machine: Machine) -> None:
    machine.gate.send(STOP, state="paused", actions=("stop",), batch=machine.sense())
    machine.go(0.1, STOP, "clear_stop", state="paused")
    machine.is_closed = False
    machine.gate.send(batch=machine.sense())
    assert machine.gate.supervisor.gate.fact == MotorsUnpowered()


def test_the_red_button_opens_the_contactor_until_it_is_released_and_cleared(
    machine: Machine,
) -> None:
    machine.button = True
    machine.go(0.1)
    assert machine.sent.is_power_cut and holds(machine.stopped, ButtonPressed)
    machine.go(2.0, STOP, "clear_stop", state="paused")
    assert machine.sent.is_power_cut, "it is still pressed"
    machine.button = False
    machine.go(1.0, STOP, "clear_stop", state="paused")
    assert not machine.sent.is_power_cut


def test_a_stopped_robot_whose_wheels_nobody_sees_loses_its_power(machine: Machine) -> None:
    machine.are_wheels_seen = False
    machine.go(0.6)
    assert (
        holds(machine.stopped, SensorSilent("wheels", ANY, 0.3, ANY))
        and not machine.sent.is_power_cut
    )
    machine.go(BLIND_S)
    assert machine.sent.is_power_cut
    machine.go(2.0, STOP, "clear_stop", state="paused")
    assert machine.sent.is_power_cut, "no report says that they stand"


def test_a_robot_that_begins_stopped_begins_without_power_and_others_with_it() -> None:
    begun = Machine()
    begun.go(TICK_S, STOP, "stop", state="paused")
    assert begun.sent.is_power_cut
    begun.go(1.0, STOP, "clear_stop", state="paused")
    assert not begun.sent.is_power_cut
    assert not Machine().go(TICK_S).is_power_cut


@pytest.mark.parametrize(
    ("harm", "wanted"),
    [
        ({"is_silent": True}, ContactorSilent(ANY, 0.3)),
        ({"fault": RelayLost("USB")}, ContactorInTrouble(cause=RelayLost("USB"))),
    ],
)
def test_a_contactor_that_does_not_answer_stops_the_robot_and_is_named(
    harm: dict[str, object], wanted: Fact, machine: Machine
) -> None:
    for name, value in harm.items():
        setattr(machine, name, value)
    machine.go(1.0)
    assert holds(machine.stopped, wanted)
    assert machine.sent.is_power_cut
    before = machine.stopped
    for name in harm:
        setattr(machine, name, False if name == "is_silent" else None)
    machine.go(2.0)
    assert machine.stopped == before, "it answers again, and the stop stays"
    machine.go(1.0, STOP, "clear_stop", state="paused")
    assert not machine.sent.is_power_cut and not machine.stopped


def test_a_contactor_that_stays_open_is_named(machine: Machine) -> None:
    machine.gate.send(STOP, state="paused", actions=("stop",), batch=machine.sense())
    for _ in range(round(2.0 / TICK_S)):
        machine.is_closed = False
        machine.gate.send(batch=machine.sense(), actions=("clear_stop",))
    assert holds(machine.gate.supervisor.gate.fact, ContactorStaysOpen)


@pytest.mark.parametrize("is_told", [True, False])
def test_a_contactor_that_does_not_open_calls_for_the_red_button(
    is_told: bool, machine: Machine
) -> None:
    machine.is_welded = is_told
    run_away(machine)
    machine.go(OPENING_S + 0.5)
    assert machine.sent.is_power_cut
    assert holds(machine.reason, STUCK)


def test_a_robot_of_which_one_of_two_contactors_is_welded_stands_and_drives_no_more(
    machine: Machine,
) -> None:
    machine.is_one_welded = True
    run_away(machine)
    assert holds(machine.reason, CUT), "the other one opened"
    machine.wheels = None
    machine.go(OPENING_S + 0.5, STOP, state="paused")
    machine.go(2.0, STOP, "clear_stop", state="paused")
    assert machine.sent.is_power_cut
    assert holds(machine.reason, ContactorWelded)
    machine.is_one_welded = False  # it is replaced
    machine.go(2.0, STOP, "clear_stop", state="paused")
    assert not machine.stopped and not machine.sent.is_power_cut


def test_a_wheel_that_rolls_out_slows_down_and_is_no_welded_contactor(machine: Machine) -> None:
    run_away(machine)
    for v_mps in (0.9, 0.75, 0.6, 0.4, 0.2):
        machine.wheels = DriveCommand(v_mps=v_mps)
        machine.go(0.4)
        assert not holds(machine.reason, Runaway) or holds(machine.reason, CUT)


def test_the_list_before_the_start_says_that_there_is_no_contactor() -> None:
    machine = Machine(has_contactor=False)
    machine.go(TICK_S, STOP, state="waiting")
    batch = machine.sense()
    machine.gate.send(batch=batch)
    (item,) = (c for c in machine.gate.supervisor.gate.checks if c.name == CONTACTOR)
    assert (item.is_ok, item.fact) == (True, NoContactor())
    with_one = Machine()
    with_one.fault = RelayLost("/dev/ttyUSB3")
    with_one.go(TICK_S, STOP, state="waiting")
    with_one.gate.send(batch=with_one.sense())
    assert with_one.gate.supervisor.gate.state == "stopped"
