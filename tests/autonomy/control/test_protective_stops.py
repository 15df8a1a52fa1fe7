"""What stops the robot by itself, and how a person gets it going again."""

from __future__ import annotations

import math
from typing import get_args
from unittest.mock import ANY

import msgspec
import pytest

from agribot.autonomy.control.bumper import RELEASE_S
from agribot.autonomy.control.supervise import Supervisor
from agribot.core.config import SafetyConfig
from agribot.core.facts import (
    ClockJumped,
    ClockStands,
    ClockUnreadable,
    ClockWentBack,
    End,
    Fact,
    MotorsReportFault,
    OnlyAway,
    Runaway,
    StillTouches,
    StoppedBy,
    StopToClear,
    Tilted,
    Touched,
    Wheel,
    WheelsWrong,
)
from agribot.core.latch import Latch
from agribot.core.messages import (
    STOP,
    WHEEL_NAMES,
    BumperSample,
    ClearStop,
    DriveCommand,
    MissionState,
    PressStop,
    RequestWord,
    SensorBatch,
)
from tests.asking import BY_WORD, ask
from tests.autonomy.control.kinematic_rover import TICK_S
from tests.autonomy.control.test_supervisor import (
    FORWARD,
    ROBOT,
    Gate,
    assert_stopped,
    tilted_batch,
)
from tests.finding import holds, is_like

AHEAD, BACK = DriveCommand(v_mps=0.3), DriveCommand(v_mps=-0.3)


def touching(gate: Gate, x_body_m: float, t_s: float | None = None) -> SensorBatch:
    t_s = gate.rover.t_s + TICK_S if t_s is None else t_s
    touch = BumperSample(t_s=t_s, x_body_m=x_body_m, y_body_m=0.1)
    return msgspec.structs.replace(gate.rover.batch(), t_s=t_s, bumper=(touch,))


@pytest.mark.parametrize(
    ("state", "is_by_hand"), [("running", False), ("paused", True), ("done", True)]
)
def test_a_touch_stops_the_robot_in_its_very_tick_whoever_drives(
    state: MissionState, is_by_hand: bool
) -> None:
    gate = Gate()
    for _ in range(50):
        gate.send(AHEAD, state=state, is_by_hand=is_by_hand)
    sent, reason = gate.send(AHEAD, batch=touching(gate, 0.5), state=state, is_by_hand=is_by_hand)
    touched = Touched("front", 0.5, 0.1, "left")
    assert_stopped(sent, reason, touched)
    for _ in range(200):  # what was touched is gone, the stop is not
        assert_stopped(*gate.send(AHEAD, state=state, is_by_hand=is_by_hand), touched)
    gate.send(STOP, state="paused", actions=("clear_stop",))
    sent, reason = gate.send(AHEAD, state=state, is_by_hand=is_by_hand)
    assert sent.drive.v_mps > 0.0
    assert reason is None


def test_a_robot_that_stands_is_held_by_a_touch_too() -> None:
    gate = Gate()
    gate.send(STOP, state="waiting", batch=touching(gate, 0.5))
    assert_stopped(*gate.send(FORWARD), StopToClear, Touched)


@pytest.mark.parametrize(
    ("x_body_m", "end", "away"),
    [(0.5, "front", BACK), (-0.5, "behind", AHEAD), (0.01, "front", BACK)],
)
def test_while_it_touches_a_hand_gets_the_robot_straight_away_only(
    x_body_m: float, end: End, away: DriveCommand
) -> None:
    gate = Gate()
    gate.send(STOP, state="paused", batch=touching(gate, x_body_m))
    gate.send(STOP, state="paused", batch=touching(gate, x_body_m), actions=("clear_stop",))

    def by_hand(drive: DriveCommand) -> tuple[DriveCommand, Fact | None]:
        batch = touching(gate, x_body_m)
        sent, reason = gate.send(drive, state="paused", batch=batch, is_by_hand=True)
        return sent.drive, reason

    towards = DriveCommand(v_mps=-away.v_mps)
    turning = DriveCommand(yaw_rate_radps=0.5)
    for wanted in (towards, turning):
        assert by_hand(wanted) == (STOP, OnlyAway((end,)))
    drive, _ = by_hand(DriveCommand(v_mps=away.v_mps, yaw_rate_radps=0.4))
    assert drive.v_mps * away.v_mps > 0.0
    assert drive.yaw_rate_radps == 0.0
    for _ in range(math.ceil(RELEASE_S / TICK_S) + 1):
        sent, reason = gate.send(away, state="paused", is_by_hand=True)
        assert sent.drive.v_mps * away.v_mps > 0.0
    sent, reason = gate.send(towards, state="paused", is_by_hand=True)
    assert reason is None, "it touches no more"


def test_a_touch_on_the_other_side_while_backing_off_stops_again() -> None:
    gate = Gate()
    gate.send(STOP, state="paused", batch=touching(gate, 0.5))
    gate.send(STOP, state="paused", actions=("clear_stop",))
    sent, _ = gate.send(BACK, state="paused", is_by_hand=True)
    assert sent.drive.v_mps < 0.0
    sent, reason = gate.send(BACK, state="paused", batch=touching(gate, -0.5), is_by_hand=True)
    assert_stopped(sent, reason, StopToClear(Touched("behind", 0.5, 0.1, "left")))
    for _ in range(100):
        assert_stopped(*gate.send(AHEAD, state="paused", is_by_hand=True), StopToClear)


def test_a_mission_does_not_go_on_while_the_robot_touches() -> None:
    gate = Gate().cruise()
    gate.send(batch=touching(gate, 0.5))
    gate.send(STOP, state="paused", batch=touching(gate, 0.5), actions=("clear_stop",))
    sent, reason = gate.send(batch=touching(gate, 0.5))
    assert_stopped(sent, reason, StillTouches(("front",)))


@pytest.mark.parametrize(
    "faults", [(WHEEL_NAMES[3],), (WHEEL_NAMES[0], WHEEL_NAMES[1]), ("overheated",)]
)
def test_a_motor_fault_of_the_board_stops_and_names_the_motor(faults: tuple[str, ...]) -> None:
    gate = Gate().cruise()
    assert_stopped(*gate.send(batch=faulty(gate, faults)), MotorsReportFault(faults))
    assert_stopped(*gate.send(), MotorsReportFault(faults))


def faulty(gate: Gate, faults: tuple[str, ...]) -> SensorBatch:
    batch = msgspec.structs.replace(gate.rover.batch(), t_s=gate.rover.t_s + TICK_S)
    wheels = tuple(msgspec.structs.replace(wheel, faults=faults) for wheel in batch.wheels)
    return msgspec.structs.replace(batch, wheels=wheels)


def test_a_robot_with_a_dead_motor_is_driven_off_by_hand_but_takes_up_no_mission() -> None:
    gate = Gate().cruise()
    dead = (WHEEL_NAMES[3],)
    gate.send(batch=faulty(gate, dead))
    gate.send(STOP, state="paused", batch=faulty(gate, dead), actions=("clear_stop",))
    for _ in range(50):
        sent, reason = gate.send(BACK, state="paused", batch=faulty(gate, dead), is_by_hand=True)
        assert reason is None
    assert sent.drive == BACK
    assert_stopped(*gate.send(batch=faulty(gate, dead)), MotorsReportFault(dead))


def test_who_clears_a_stop_of_their_own_has_not_accepted_a_fault_that_comes_later() -> None:
    gate = Gate().cruise()
    gate.send(batch=faulty(gate, (WHEEL_NAMES[3],)))
    gate.send(STOP, state="paused", actions=("clear_stop",))
    gate.cruise()  # the motor was fixed
    gate.send(STOP, state="paused", actions=("stop",))
    gate.send(STOP, state="paused", actions=("clear_stop",))
    dead = (WHEEL_NAMES[0],)
    sent, reason = gate.send(AHEAD, state="paused", batch=faulty(gate, dead), is_by_hand=True)
    assert_stopped(sent, reason, MotorsReportFault(dead))


def test_a_fault_that_only_an_earlier_sample_of_a_tick_tells_of_stops_the_robot_too() -> None:
    gate = Gate().cruise()
    before = faulty(gate, (WHEEL_NAMES[3],)).wheels[0]
    after = msgspec.structs.replace(before, faults=(WHEEL_NAMES[0],))
    well = msgspec.structs.replace(before, faults=())
    batch = msgspec.structs.replace(gate.rover.batch(), wheels=(before, after, after, well))
    sent, reason = gate.send(batch=msgspec.structs.replace(batch, t_s=gate.rover.t_s + TICK_S))
    assert_stopped(sent, reason, MotorsReportFault((WHEEL_NAMES[3], WHEEL_NAMES[0])))


def test_a_tilt_waits_for_a_person_who_drives_the_robot_down_by_hand() -> None:
    gate = Gate().cruise()
    steep = (9.8 * math.sin(0.9), 0.0, 9.8 * math.cos(0.9))
    for _ in range(100):
        sent, reason = gate.send(batch=tilted_batch(gate, steep))
    assert_stopped(sent, reason, StopToClear, Tilted)
    for _ in range(200):  # it was put upright again
        assert_stopped(*gate.send(), Tilted)
    gate.send(STOP, state="paused", batch=tilted_batch(gate, steep), actions=("clear_stop",))
    for _ in range(100):
        sent, reason = gate.send(
            BACK, state="paused", batch=tilted_batch(gate, steep), is_by_hand=True
        )
        assert reason is None
    assert sent.drive == BACK
    sent, reason = gate.send(batch=tilted_batch(gate, steep))
    assert_stopped(sent, reason, Tilted)


@pytest.mark.parametrize(
    ("step_s", "wanted"),
    [
        (-5.0, ClockWentBack(4.98)),
        (10.0, ClockJumped(10.02, 1.0)),
        (math.nan, ClockUnreadable(math.nan)),
    ],
)
def test_a_clock_that_jumps_stops_the_robot_until_a_person_clears_it(
    step_s: float, wanted: Fact
) -> None:
    gate = Gate().cruise()
    gate.rover.t_s += step_s
    sent, reason = gate.send()
    assert_stopped(sent, reason, wanted)
    gate.rover.t_s = 100.0
    for _ in range(100):
        assert_stopped(*gate.send(), wanted)
    assert gate.send(actions=("clear_stop",))[1] is None


def test_a_clock_that_stands_stops_the_robot() -> None:
    gate = Gate().cruise()
    t_s = gate.rover.t_s
    for _ in range(10):
        batch = msgspec.structs.replace(gate.rover.batch(), t_s=t_s)
        sent, reason = gate.send(batch=batch)
    assert_stopped(sent, reason, ClockStands(t_s))


def test_a_slow_tick_is_no_jump_of_the_clock() -> None:
    gate = Gate().cruise()
    gate.rover.t_s += 0.25
    assert gate.send()[1] is None


def test_nothing_latches_while_the_robot_is_not_to_move() -> None:
    """Before the mission begins sensors come and go, and people carry and tilt the robot."""
    gate = Gate()
    for state in ("waiting", "paused"):
        for _ in range(50):
            batch = tilted_batch(gate, (9.8, 0.0, 0.0))
            gate.send(STOP, state=state, batch=msgspec.structs.replace(batch, wheels=()))
        for _ in range(200):
            gate.send(STOP, state=state)
    gate.cruise()


@pytest.mark.parametrize("actions", [("stop",), ()], ids=["STOP", "pause"])
@pytest.mark.parametrize("drive", [STOP, AHEAD], ids=["at rest", "asked to move"])
def test_a_board_that_runs_on_though_the_robot_should_stand_is_told_until_it_stands(
    actions: tuple[RequestWord, ...], drive: DriveCommand
) -> None:
    gate = Gate().cruise()
    gate.send(STOP, state="paused", actions=actions)
    reasons = []
    for _ in range(100):
        gate.rover.turn_wheels(DriveCommand(v_mps=1.0))
        sent, reason = gate.send(drive if actions else STOP, state="paused")
        assert sent.drive == STOP
        reasons.append(reason)
    too_fast = WheelsWrong(get_args(Wheel), "fast", 7.7, 0.0)
    assert holds(reasons[-1], too_fast, within=0.05)
    by_itself = WheelsWrong(get_args(Wheel), "fast", ANY, 0.0)
    assert is_like(gate.supervisor._latch.cause, StoppedBy("operator") if actions else by_itself)
    for _ in range(50):
        sent, reason = gate.send(STOP, state="paused")
    assert not holds(reason, Runaway)
    for _ in range(100):
        gate.rover.turn_wheels(DriveCommand(v_mps=0.25))  # people push it
        assert not holds(gate.send(STOP, state="paused")[1], Runaway)


def test_a_latch_closed_by_others_holds_the_robot_and_keeps_its_first_reason() -> None:
    latch = Latch()
    latch.hold(StoppedBy("Ann"))
    gate = Gate()
    gate.supervisor = Supervisor(SafetyConfig(), ROBOT, latch)
    assert_stopped(*gate.send(batch=touching(gate, 0.5)), StoppedBy("Ann"))
    latch.hear(ask(PressStop(), "Bert"))
    assert latch.cause == StoppedBy("Ann")
    for action in ("resume", "start", "pause"):
        latch.hear(ask(BY_WORD[action]))
    assert latch.cause == StoppedBy("Ann")
    latch.hear(ask(ClearStop()))
    assert latch.cause is None
