from __future__ import annotations

import math

import pytest

from agribot.autonomy.control.hand_drive import HandControl
from agribot.core.config import SafetyConfig
from agribot.core.facts import CommandNotFinite, PausedByHand, SpeedLimited, StoppedBy
from agribot.core.messages import DriveCommand, HandDrive, MissionState, PauseFor, SensorBatch, Who
from tests.autonomy.control.test_supervisor import Gate, goal
from tests.finding import holds

MISSION = DriveCommand(v_mps=0.4, yaw_rate_radps=0.0)


def batch(t_s: float, *speeds_mps: float) -> SensorBatch:
    hand = tuple(
        HandDrive(t_s=t_s, v_mps=speed, yaw_rate_radps=0.0, who=Who("gamepad"))
        for speed in speeds_mps
    )
    return SensorBatch(t_s=t_s, hand=hand)


def driven(control: HandControl, state: MissionState = "paused") -> DriveCommand | None:
    drive, is_by_hand = control.arbitrate(MISSION, goal(state).status)
    return drive if is_by_hand else None


def test_a_hand_that_moves_the_robot_pauses_the_mission_and_drives() -> None:
    control = HandControl(SafetyConfig())
    (event,) = control.update(batch(1.0, 0.2))
    assert event.request == PauseFor(cause=PausedByHand("gamepad"))
    assert event.who == Who("gamepad")
    assert driven(control) == DriveCommand(v_mps=0.2, yaw_rate_radps=0.0)


def test_a_stick_at_rest_leaves_a_running_mission_alone() -> None:
    control = HandControl(SafetyConfig())
    assert control.update(batch(1.0, 0.0)) == ()
    assert driven(control, "running") is None


def test_a_hand_that_falls_silent_counts_no_longer_than_its_timeout() -> None:
    control = HandControl(SafetyConfig(hand_timeout_s=0.3))
    control.update(batch(1.0, 0.2))
    control.update(batch(1.28))
    assert driven(control) is not None
    control.update(batch(1.3))
    assert driven(control) is None


def test_a_clock_that_runs_backwards_ends_the_request() -> None:
    control = HandControl(SafetyConfig())
    control.update(batch(10.0, 0.2))
    control.update(batch(3.0))
    assert driven(control) is None


@pytest.mark.parametrize("state", ["waiting", "paused", "done", "failed", "cancelled"])
def test_the_supervisor_lets_a_hand_drive_without_mission_or_position(state: MissionState) -> None:
    gate = Gate()
    lost = gate.lost_estimate()
    for _ in range(100):
        command, reason = gate.send(MISSION, estimate=lost, state=state, is_by_hand=True)
    assert reason is None
    assert command.drive.v_mps == pytest.approx(0.4)
    assert not command.implement.is_on


def test_a_stop_holds_against_a_hand_until_it_is_cleared() -> None:
    gate = Gate()
    command, reason = gate.send(MISSION, state="paused", actions=("stop",), is_by_hand=True)
    assert command.drive.v_mps == 0.0
    assert holds(reason, StoppedBy("operator"))
    command, _ = gate.send(MISSION, state="paused", actions=("clear_stop",), is_by_hand=True)
    assert command.drive.v_mps > 0.0


@pytest.mark.parametrize("speed_mps", [math.nan, math.inf, -math.inf])
def test_a_hand_that_asks_for_a_number_that_is_none_gets_nothing(speed_mps: float) -> None:
    drive = DriveCommand(v_mps=speed_mps, yaw_rate_radps=0.0)
    command, reason = Gate().send(drive, state="paused", is_by_hand=True)
    assert command.drive == DriveCommand()
    assert isinstance(reason, CommandNotFinite)


def test_a_hand_gets_no_more_speed_than_the_robot_is_allowed() -> None:
    gate = Gate()
    for _ in range(200):
        command, reason = gate.send(DriveCommand(v_mps=50.0), state="paused", is_by_hand=True)
    assert command.drive.v_mps <= SafetyConfig().max_speed_mps
    assert isinstance(reason, SpeedLimited)
