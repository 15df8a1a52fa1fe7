"""Motors that draw what they should, little or nothing, and the torque that follows from it."""

from __future__ import annotations

import pytest

from agribot.core.messages import WHEEL_NAMES
from agribot.description.loader import load_robot
from agribot.drivers.board.motor_watch import LASTING_S, MOST_SENSED_A, SENSOR_STEP_A, MotorWatch

DRIVE = load_robot().drive
SUPPLY_V, STEP_S = 25.0, 0.01
CONSTANT = DRIVE.torque_constant_nmpa


class Motor:
    """V = R I + k w, and a board's report of it; `share` of its current gets through."""

    def __init__(self, speed_radps: float, share: float = 1.0, gain: float = 1.0,
                 more_ohm: float = 0.0) -> None:  # fmt: skip
        self.speed_radps, self._share = speed_radps, share
        self._constant, self._ohm = gain * CONSTANT, DRIVE.winding_ohm + more_ohm

    def draw(self, duty: float) -> float:
        amperes = abs(self._share * (duty * SUPPLY_V - self._constant * self.speed_radps))
        return min(amperes / self._ohm, MOST_SENSED_A) // SENSOR_STEP_A * SENSOR_STEP_A


def watch(motor: Motor, duty: float, seconds: float = 2.0) -> float | None:
    """Drive three motors as they should be, and this one; gives when it is named."""
    watch, good = MotorWatch(DRIVE, CONSTANT, DRIVE.winding_ohm), Motor(motor.speed_radps)
    duties = (duty, duty, duty, duty)
    speeds = (motor.speed_radps,) * 4
    drawn = (good.draw(duty), good.draw(duty), good.draw(duty), motor.draw(duty))
    for tick in range(1, round(seconds / STEP_S) + 1):
        named = watch.update(tick * STEP_S, SUPPLY_V, duties, speeds, drawn)
        assert set(named) <= {WHEEL_NAMES[3]}
        if named:
            return tick * STEP_S
    return None


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.2])
def test_a_motor_that_lets_little_through_is_named_within_half_a_second(
    share: float, sign: float
) -> None:
    named_s = watch(Motor(sign * 4.0, share), sign * 0.09)
    assert named_s is not None
    assert LASTING_S < named_s < 0.5


@pytest.mark.parametrize("gain", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("more_ohm", [0.0, 0.3])
@pytest.mark.parametrize("speed_radps", [-8.0, -1.0, 0.0, 0.5, 4.0, 8.0])
@pytest.mark.parametrize("duty", [-1.0, -0.1, 0.0, 0.02, 0.05, 0.08, 0.2, 0.5, 1.0])
def test_a_motor_that_works_is_not_named_though_little_is_known_of_it(
    duty: float, speed_radps: float, more_ohm: float, gain: float
) -> None:
    assert watch(Motor(speed_radps, 1.0, gain, more_ohm), duty) is None


def test_who_does_not_turn_or_turns_the_other_way_is_for_who_watches_the_wheels() -> None:
    assert watch(Motor(0.0, 0.0), 0.3) is None
    assert watch(Motor(-2.0, 0.0), 0.3) is None


def test_a_motor_that_should_brake_and_does_not_is_named_where_the_others_do() -> None:
    named_s = watch(Motor(4.0, 0.0), 0.02)
    assert named_s is not None and named_s < 0.5
    freewheeling, told = (
        MotorWatch(DRIVE, CONSTANT, DRIVE.winding_ohm),
        ((0.02,) * 4, (4.0,) * 4, (0.0,) * 4),
    )
    for tick in range(200):
        assert freewheeling.update(tick * STEP_S, SUPPLY_V, *told) == (), "none of them brakes"


def test_a_moment_is_no_fault() -> None:
    watch, duties, speeds = MotorWatch(DRIVE, CONSTANT, DRIVE.winding_ohm), (0.1,) * 4, (4.0,) * 4
    for tick in range(200):
        drawn = (0.0 if tick % 25 else 4.0,) * 4
        assert watch.update(tick * STEP_S, SUPPLY_V, duties, speeds, drawn) == ()


@pytest.mark.parametrize("duty", [-0.3, 0.02, 0.05, 0.08, 0.5])
def test_the_torque_is_that_of_the_current_in_the_direction_of_the_voltage_that_is_left(
    duty: float,
) -> None:
    motor = Motor(4.0)
    amperes = (duty * SUPPLY_V - CONSTANT * motor.speed_radps) / DRIVE.winding_ohm
    told = (max(min(abs(amperes), MOST_SENSED_A), 0.0),) * 4
    torque_nm = MotorWatch(DRIVE, CONSTANT, DRIVE.winding_ohm).torques_nm(
        SUPPLY_V, (duty,) * 4, (4.0,) * 4, told
    )[0]
    geared = DRIVE.gear_efficiency_ratio if amperes > 0.0 else 1.0
    sensed_a = max(min(amperes, MOST_SENSED_A), -MOST_SENSED_A)
    assert torque_nm == pytest.approx(sensed_a * CONSTANT * geared, abs=SENSOR_STEP_A * CONSTANT)


def test_a_motor_at_rest_without_duty_has_no_torque() -> None:
    still = (0.0,) * 4
    assert (
        MotorWatch(DRIVE, CONSTANT, DRIVE.winding_ohm).torques_nm(SUPPLY_V, still, still, still)
        == still
    )
