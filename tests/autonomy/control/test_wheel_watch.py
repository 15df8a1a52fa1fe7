"""Wheels, torque and gyro against the motor commands, tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from typing import get_args

import pytest

from agribot.autonomy.control.wheel_watch import WheelWatch
from agribot.core.facts import (
    Fact,
    HeldInTurn,
    ImuFrozen,
    Motion,
    MotorDead,
    TurnsDisagree,
    Wheel,
    WheelsSwapped,
    WheelsWrong,
    find_kind,
)
from agribot.core.messages import STOP, DriveCommand, Four, ImuSample, SensorBatch, WheelSample
from tests.autonomy.control.kinematic_rover import TICK_S
from tests.robot_parts import plain_rover

DRIVE = plain_rover().drive
DELAY_S = 0.3
AHEAD = DriveCommand(v_mps=0.4)
TURN = DriveCommand(v_mps=0.3, yaw_rate_radps=0.5)
Wheels = Callable[[Four], Four]
ALL: tuple[Wheel, ...] = get_args(Wheel)
at_rates = pytest.mark.parametrize("rate_hz", [50, 25, 10])


PUSH_RADPS = 0.28 / DRIVE.wheel_radius_m


def turning(speed_radps: float) -> Wheels:
    """All wheels turn at this speed, whatever the command."""
    return lambda _: (speed_radps,) * 4


class Bench:
    """A board that follows its commands by `wheels`, and a gyro that agrees with the wheels.

    The board sends its encoders at `rate_hz`; the gyro sends in every tick.
    """

    def __init__(self, wheels: Wheels = lambda told: told, rate_hz: float = 50.0) -> None:
        self._ticks_between = round(1.0 / (rate_hz * TICK_S))
        self.watch = WheelWatch(DRIVE, DELAY_S)
        self.wheels = wheels
        self.gyro_off_radps = 0.0
        self.is_imu_frozen = False
        self.is_held = False  # as a receiver shows
        self.is_stop_pressed = False  # in the next tick
        self.has_power = True
        self.effort_nm: Four | None = None
        self.runaway: Fact | None = None
        self.t_s = 0.0
        self._angles = [0.0] * 4
        self._sent = STOP

    def drive(
        self, command: DriveCommand, seconds: float
    ) -> tuple[float, Fact | None, Fact | None]:
        """Until something is found: after how long, of the wheels, and what else is in doubt."""
        for tick in range(1, round(seconds / TICK_S) + 1):
            self.t_s += TICK_S
            left, right = DRIVE.wheel_speeds_radps(self._sent.v_mps, self._sent.yaw_rate_radps)
            speeds = self.wheels((right, left, right, left))
            for k, speed in enumerate(speeds):
                self._angles[k] += speed * TICK_S
            found = self.watch.watch(
                self._sent, self._batch(), TICK_S,
                is_held=self.is_held, is_stop_pressed=self.is_stop_pressed,
                has_power=self.has_power,
            )  # fmt: skip
            self.is_stop_pressed = False
            self._sent, self.runaway = command, found.runaway
            if any(found):
                doubt = found.dead_motor or found.frozen_imu or found.wrong_turn or found.held
                return tick * TICK_S, found.wheels, doubt
        return seconds, None, None

    def _batch(self) -> SensorBatch:
        a, b, c, d = self._angles
        wheel = WheelSample(
            t_s=self.t_s, angle_rad=(a, b, c, d), speed_radps=(0.0,) * 4, effort_nm=self.effort_nm
        )
        tick = round(self.t_s / TICK_S)
        hum = 0.0 if self.is_imu_frozen else 1e-4 * (tick % 7)
        yaw_rate = 0.0 if self.is_imu_frozen else self._sent.yaw_rate_radps + self.gyro_off_radps
        imu = ImuSample(t_s=self.t_s, gyro_radps=(hum, 0.0, yaw_rate), accel_mps2=(0.0, 0.0, 9.8))
        wheels = (wheel,) if tick % self._ticks_between == 0 else ()
        return SensorBatch(t_s=self.t_s, wheels=wheels, imu=(imu,))


def one(index: int, ratio: float) -> Wheels:
    def change(told: Four) -> Four:
        a, b, c, d = (ratio * speed if k == index else speed for k, speed in enumerate(told))
        return a, b, c, d

    return change


def every(ratio: float) -> Wheels:
    return lambda told: (ratio * told[0], ratio * told[1], ratio * told[2], ratio * told[3])


@at_rates
@pytest.mark.parametrize(
    ("wheels", "named", "motion", "speed_radps"),
    [
        (one(3, 0.0), ("left_wheel_F",), "stand", 0.0),
        (one(0, 0.2), ("right_wheel_R",), "slow", 0.6),
        (one(1, 2.5), ("left_wheel_R",), "fast", 7.7),
        (one(2, -1.0), ("right_wheel_F",), "backwards", -3.1),
        (every(0.0), ALL, "stand", 0.0),
        (every(2.5), ALL, "fast", 7.7),
        (every(-1.0), ALL, "backwards", -3.1),
        (lambda told: (told[0], 0.0, told[2], 0.0), ("left_wheel_R", "left_wheel_F"), "stand", 0.0),
    ],
)  # fmt: skip
def test_a_wheel_that_does_not_as_told_is_named_within_a_second(
    wheels: Wheels,
    named: tuple[Wheel, ...],
    motion: Motion,
    speed_radps: float,
    rate_hz: float,
) -> None:
    bench = Bench(rate_hz=rate_hz)
    assert bench.drive(AHEAD, 2.0)[1:] == (None, None)
    bench.wheels = wheels
    after_s, found, _ = bench.drive(AHEAD, 2.0)
    assert isinstance(found, WheelsWrong)
    assert (found.wheels, found.motion) == (named, motion)
    assert found.speed_radps == pytest.approx(speed_radps, abs=0.1)
    assert found.wanted_radps == pytest.approx(3.1, abs=0.1)
    assert after_s < 0.7
    after_s, found, _ = Bench(wheels, rate_hz).drive(AHEAD, 2.0)
    assert find_kind(found) == WheelsWrong(named, motion, 0.0, 0.0).kind, "from the start on"
    assert after_s <= 1.0


@at_rates
def test_left_and_right_that_are_swapped_are_told_in_a_turn(rate_hz: float) -> None:
    bench = Bench(lambda told: (told[1], told[0], told[1], told[0]), rate_hz)
    assert bench.drive(AHEAD, 2.0)[1] is None
    after_s, found, _ = bench.drive(TURN, 2.0)
    assert found == WheelsSwapped()
    assert after_s <= 1.0


def test_a_wheel_that_turns_though_it_should_stand_is_told() -> None:
    bench = Bench()
    bench.drive(AHEAD, 1.0)
    bench.wheels = lambda told: (told[0], 4.0, told[2], told[3])
    _, found, _ = bench.drive(STOP, 2.0)
    assert isinstance(found, WheelsWrong)
    assert (found.wheels, found.motion, found.wanted_radps) == (("left_wheel_R",), "fast", 0.0)
    assert found.speed_radps == pytest.approx(4.0, abs=0.05)
    assert bench.runaway == found


@at_rates
def test_wheels_run_away_that_never_came_to_stand_but_not_those_that_people_push(
    rate_hz: float,
) -> None:
    bench = Bench(rate_hz=rate_hz)
    bench.drive(AHEAD, 1.0)
    bench.wheels = lambda told: (4.0, 4.0, 4.0, 4.0)
    bench.drive(STOP, 2.0)
    assert isinstance(bench.runaway, WheelsWrong)
    assert (bench.runaway.wheels, bench.runaway.motion) == (ALL, "fast")
    for _ in range(100):
        bench.drive(STOP, TICK_S)
        assert bench.runaway, "in every tick, however seldom the encoders speak"
    bench.wheels = every(1.0)
    for _ in range(50):
        bench.drive(STOP, TICK_S)
    assert bench.runaway is None
    bench.wheels = turning(PUSH_RADPS)
    for _ in range(100):
        bench.drive(STOP, TICK_S)
        assert bench.runaway is None


def wait_for_runaway(bench: Bench, seconds: float = 1.0) -> float | None:
    """Stand until wheels are driven: after how long."""
    for tick in range(1, round(seconds / TICK_S) + 1):
        bench.drive(STOP, TICK_S)
        if bench.runaway:
            return tick * TICK_S
    return None


@at_rates
@pytest.mark.parametrize("has_driven", [False, True])
@pytest.mark.parametrize(
    ("wheels", "effort_nm", "within_s"),
    [
        (turning(4.0), None, 0.35),
        (turning(-7.0), (-0.3,) * 4, 0.35),  # as a board with a wrong sign of the torque reports it
        (turning(1.0), (0.2,) * 4, 0.45),
        (turning(-1.0), (-0.2,) * 4, 0.45),
        (lambda _: (0.0, 1.0, 0.0, 0.1), None, 0.7),
    ],
    ids=["too fast to be pushed", "braked", "motors drive", "backwards", "one wheel alone"],
)  # fmt: skip
def test_wheels_that_stood_are_driven_where_they_turn_as_no_push_turns_them(
    wheels: Wheels, effort_nm: Four | None, within_s: float, has_driven: bool, rate_hz: float
) -> None:
    bench = Bench(rate_hz=rate_hz)
    bench.drive(AHEAD if has_driven else STOP, 1.0)
    bench.drive(STOP, 2.0)
    bench.wheels, bench.effort_nm = wheels, effort_nm
    after_s = wait_for_runaway(bench)
    assert after_s is not None
    assert after_s <= within_s
    assert isinstance(bench.runaway, WheelsWrong) and bench.runaway.motion != "stand"


@at_rates
@pytest.mark.parametrize(
    ("wheels", "effort_nm"),
    [
        (turning(PUSH_RADPS), None),
        (turning(-PUSH_RADPS), (3.0,) * 4),
        (turning(PUSH_RADPS), (0.01,) * 4),
        (lambda _: (PUSH_RADPS, -PUSH_RADPS, PUSH_RADPS, -PUSH_RADPS), None),
        (lambda _: (PUSH_RADPS, PUSH_RADPS, 0.0, 0.0), None),
        (lambda _: (0.0, 0.0, 0.0, 0.1), (3.0,) * 4),
    ],
    ids=["ahead", "braked", "noise", "around", "front lifted", "held on a slope"],
)  # fmt: skip
def test_pushing_below_three_tenths_of_a_metre_per_second_is_no_runaway(
    wheels: Wheels, effort_nm: Four | None, rate_hz: float
) -> None:
    bench = Bench(wheels, rate_hz)
    bench.effort_nm = effort_nm
    assert wait_for_runaway(bench, 3.0) is None


def test_an_encoder_that_rocks_between_two_counts_at_rest_is_no_runaway() -> None:
    bench = Bench()
    count_rad = 0.07  # of a motor with Hall sensors
    for tick in range(200):
        bench.wheels = turning(0.0)
        bench._angles[2] = count_rad * (tick // 6 % 2)
        assert wait_for_runaway(bench, TICK_S) is None


@at_rates
def test_a_robot_that_was_pushed_away_may_spring_back_for_a_moment(rate_hz: float) -> None:
    bench = Bench(turning(PUSH_RADPS), rate_hz)
    bench.effort_nm = (-2.0,) * 4
    assert wait_for_runaway(bench) is None
    bench.wheels = turning(-PUSH_RADPS)
    assert wait_for_runaway(bench, 0.1) is None
    bench.wheels = every(1.0)
    assert wait_for_runaway(bench) is None


@at_rates
def test_a_stop_pressed_while_wheels_turn_counts_even_a_push_as_driven(rate_hz: float) -> None:
    bench = Bench(turning(PUSH_RADPS), rate_hz)
    assert wait_for_runaway(bench) is None
    bench.is_stop_pressed = True
    assert wait_for_runaway(bench, TICK_S * 50 / rate_hz) is not None
    bench.wheels = every(1.0)
    bench.drive(STOP, TICK_S)
    assert bench.runaway, "until it is seen to stand"
    for _ in range(50):
        bench.drive(STOP, TICK_S)
    assert bench.runaway is None
    bench.wheels = turning(PUSH_RADPS)
    assert wait_for_runaway(bench) is None, "it stood since"


def test_a_board_that_brakes_slowly_after_a_drive_is_given_its_time() -> None:
    bench = Bench()
    bench.drive(AHEAD, 1.0)
    bench.wheels = turning(3.1)
    assert wait_for_runaway(bench, 0.6) is None
    bench.wheels = every(1.0)
    assert wait_for_runaway(bench) is None


@at_rates
@pytest.mark.parametrize("delay_s", [0.0, 0.1, DELAY_S - 0.1])
@pytest.mark.parametrize("ratio", [0.75, 1.0, 1.25])
def test_a_slow_board_with_a_wrong_scale_that_does_as_told_is_no_fault(
    delay_s: float, ratio: float, rate_hz: float
) -> None:
    late: list[Four] = [(0.0,) * 4] * round(delay_s / TICK_S)

    def slow(told: Four) -> Four:
        late.append((ratio * told[0], ratio * told[1], ratio * told[2], ratio * told[3]))
        return late.pop(0)

    bench = Bench(slow, rate_hz)
    for command in (AHEAD, TURN, STOP, DriveCommand(v_mps=-0.4), TURN, AHEAD, STOP):
        assert bench.drive(command, 1.5)[1:] == (None, None)


@at_rates
def test_a_clod_that_holds_a_wheel_for_a_moment_is_no_fault(rate_hz: float) -> None:
    bench = Bench(rate_hz=rate_hz)
    for _ in range(10):
        assert bench.drive(AHEAD, 1.0)[1] is None
        bench.wheels = one(2, 0.1)
        assert bench.drive(AHEAD, 0.3)[1] is None
        bench.wheels = every(1.0)


@at_rates
def test_a_motor_without_torque_is_named_though_its_wheel_rolls_along(rate_hz: float) -> None:
    bench = Bench(rate_hz=rate_hz)
    bench.effort_nm = (0.3, 0.2, 0.3, 0.1)
    assert bench.drive(AHEAD, 3.0)[2] is None
    bench.effort_nm = (0.3, 0.2, 0.3, 0.0)
    after_s, wheels, doubt = bench.drive(AHEAD, 2.0)
    assert (wheels, doubt) == (None, MotorDead("left_wheel_F"))
    assert after_s < 0.7
    for effort_nm in ((0.0,) * 4, (0.01, 0.0, 0.01, 0.0), None):  # no effort; not reported
        bench = Bench(rate_hz=rate_hz)
        bench.effort_nm = effort_nm
        assert bench.drive(AHEAD, 3.0)[2] is None


@at_rates
@pytest.mark.parametrize(("off_radps", "is_told"), [(0.3, True), (-0.3, True), (0.1, False)])
def test_a_gyro_that_contradicts_the_wheels_is_told(
    off_radps: float, is_told: bool, rate_hz: float
) -> None:
    bench = Bench(rate_hz=rate_hz)
    bench.gyro_off_radps = off_radps
    after_s, wheels, doubt = bench.drive(AHEAD, 2.0)
    assert wheels is None
    assert isinstance(doubt, TurnsDisagree) is is_told
    assert not is_told or after_s <= 1.0


@at_rates
@pytest.mark.parametrize("gain", [0.3, 0.45, 0.6, 0.8, 1.2, 1.4])
def test_a_robot_that_skids_is_no_fault_of_the_gyro(gain: float, rate_hz: float) -> None:
    bench = Bench(rate_hz=rate_hz)
    turn = DriveCommand(yaw_rate_radps=1.0)
    bench.gyro_off_radps = (gain - 1.0) * turn.yaw_rate_radps
    bench.drive(turn, 0.1)
    assert bench.drive(turn, 3.0)[2] is None


@pytest.mark.parametrize(("gain", "found"), [(0.05, HeldInTurn), (-1.0, TurnsDisagree)])
def test_a_robot_that_does_not_turn_is_stuck_and_one_that_turns_backwards_has_a_wrong_gyro(
    gain: float, found: type[Fact]
) -> None:
    bench = Bench()
    bench.is_held = True
    turn = DriveCommand(yaw_rate_radps=1.0)
    bench.gyro_off_radps = (gain - 1.0) * turn.yaw_rate_radps
    bench.drive(turn, 0.1)
    assert isinstance(bench.drive(turn, 4.0)[2], found)


@at_rates
@pytest.mark.parametrize("swing_radps", [0.0, 0.05, -0.3])
def test_a_clod_that_holds_a_wheel_in_a_turn_is_climbed_and_no_fault(
    swing_radps: float, rate_hz: float
) -> None:
    """Held, the robot stands for a second or two, or swings the other way."""
    bench = Bench(rate_hz=rate_hz)
    bench.is_held = True
    turn = DriveCommand(v_mps=0.2, yaw_rate_radps=0.5)
    for _ in range(5):
        bench.gyro_off_radps = 0.0
        assert bench.drive(turn, 2.0)[1:] == (None, None)
        bench.gyro_off_radps = swing_radps - turn.yaw_rate_radps
        assert bench.drive(turn, 2.0)[1:] == (None, None)
    assert isinstance(bench.drive(turn, 2.0)[2], HeldInTurn), "where it lasts, it is"


@at_rates
@pytest.mark.parametrize("turn_radps", [0.3, 0.5, 0.8])
def test_a_gyro_that_tells_of_no_turn_while_the_robot_drives_on_is_told_within_a_second(
    turn_radps: float, rate_hz: float
) -> None:
    """A robot steers against the offset of its gyro until the gyro shows no rotation."""
    bench = Bench(rate_hz=rate_hz)
    turn = DriveCommand(v_mps=0.3, yaw_rate_radps=turn_radps)
    bench.drive(turn, 1.0)
    bench.gyro_off_radps = -turn_radps
    after_s, _, doubt = bench.drive(turn, 3.0)
    assert isinstance(doubt, TurnsDisagree)
    assert after_s <= 1.0


def test_an_imu_that_repeats_itself_is_told_of_a_moving_robot_only() -> None:
    bench = Bench()
    bench.is_imu_frozen = True
    assert bench.drive(STOP, 5.0)[2] is None, "at rest an IMU without noise may well do so"
    after_s, _, doubt = bench.drive(AHEAD, 2.0)
    assert isinstance(doubt, ImuFrozen)
    assert after_s <= 1.0


@at_rates
def test_an_encoder_that_counts_anew_is_no_fault(rate_hz: float) -> None:
    bench = Bench(rate_hz=rate_hz)
    bench.drive(AHEAD, 1.0)
    bench._angles = [1000.0, -1000.0, 0.0, 0.0]
    assert bench.drive(AHEAD, 2.0)[1] is None


def test_samples_that_were_missing_for_long_are_no_evidence() -> None:
    """Half a second without a sample is a fault by itself; what comes after it begins anew."""
    bench = Bench()
    bench.drive(AHEAD, 1.0)
    for _ in range(5):
        bench._ticks_between = 10**6
        assert bench.drive(AHEAD, 0.6)[1] is None
        bench._ticks_between = 1
        bench.wheels = one(2, 0.0)
        assert bench.drive(AHEAD, 0.1)[1] is None
        bench.wheels = every(1.0)
        assert bench.drive(AHEAD, 0.5)[1] is None


@pytest.mark.parametrize(("ratio", "is_wrong"), [(0.9, False), (1.5, True)])
def test_wheels_that_lost_their_power_may_roll_out_but_not_turn_faster(
    ratio: float, *, is_wrong: bool
) -> None:
    bench = Bench()
    bench.drive(AHEAD, 1.0)
    bench.has_power, bench.wheels = False, turning(0.4 / DRIVE.wheel_radius_m)
    assert bench.drive(STOP, 0.2)[1] is None
    bench.wheels = turning(ratio * 0.4 / DRIVE.wheel_radius_m)
    assert (bench.drive(STOP, 2.0)[1] is not None) == is_wrong


def test_wheels_that_turn_on_with_their_power_back_are_wrong_again() -> None:
    bench = Bench()
    bench.drive(AHEAD, 1.0)
    bench.has_power, bench.wheels = False, turning(0.4 / DRIVE.wheel_radius_m)
    bench.drive(STOP, 1.0)
    bench.has_power = True
    after_s, found, _ = bench.drive(STOP, 2.0)
    assert found is not None and 0.8 < after_s < 1.1
