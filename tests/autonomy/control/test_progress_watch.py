"""Wheels that turn while the robot stays, seen by the receiver."""

from __future__ import annotations

import math

import msgspec
import pytest

from agribot.autonomy.control.progress_watch import ProgressWatch
from agribot.core.facts import Fact, StopToClear, Stuck
from agribot.core.geo import WGS84_A_M
from agribot.core.messages import GnssFix, GnssQuality, ImuSample, SensorBatch, WheelSample
from tests.autonomy.control.kinematic_rover import TICK_S
from tests.autonomy.control.test_supervisor import Gate, assert_stopped
from tests.robot_parts import plain_rover

DRIVE = plain_rover().drive
SPEED_MPS = 0.4


class Ride:
    """Wheels at 0.4 m/s; the robot keeps a part of their way, slides aside and turns as set."""

    def __init__(self, quality: GnssQuality = GnssQuality.RTK_FIXED) -> None:
        self.watch = ProgressWatch(DRIVE)
        self.quality = quality
        self.kept_ratio = 1.0
        self.turn_radps = 0.0
        self.slide_rad = 0.0  # of its course against where it looks
        self.is_frozen, self.has_velocity = False, True
        self.is_on_spot = False
        self.shift_m = 0.0
        self.t_s = self.way_m = self.yaw_rad = self.x_m = self.y_m = 0.0
        self._fix_xy = 0.0, 0.0

    def go(self, seconds: float) -> Fact | None:
        found = None
        for tick in range(round(seconds / TICK_S)):
            found = self.watch.watch(self.batch(tick % 5 == 0))
            if found:
                break
        return found

    def batch(self, has_fix: bool) -> SensorBatch:
        self.t_s += TICK_S
        self.way_m += 0.0 if self.is_on_spot else SPEED_MPS * TICK_S
        self.yaw_rad += self.turn_radps * TICK_S
        v_mps = 0.0 if self.is_on_spot else self.kept_ratio * SPEED_MPS
        course_rad = self.yaw_rad + self.slide_rad
        self.x_m += v_mps * math.cos(course_rad) * TICK_S
        self.y_m += v_mps * math.sin(course_rad) * TICK_S
        angle_rad = self.way_m / DRIVE.wheel_radius_m
        wheel = WheelSample(t_s=self.t_s, angle_rad=(angle_rad,) * 4, speed_radps=(0.0,) * 4)
        gyro_radps = (0.0, 0.0, self.turn_radps)
        imu = ImuSample(t_s=self.t_s, gyro_radps=gyro_radps, accel_mps2=(0.0, 0.0, 9.8))
        fixes = (self._fix(v_mps),) if has_fix else ()
        return SensorBatch(t_s=self.t_s, wheels=(wheel,), imu=(imu,), gnss=fixes)

    def _fix(self, v_mps: float) -> GnssFix:
        if not self.is_frozen:
            self._fix_xy = self.x_m + self.shift_m, self.y_m
        x_m, y_m = self._fix_xy
        course_rad = self.yaw_rad + self.slide_rad
        velocity = v_mps * math.cos(course_rad), v_mps * math.sin(course_rad), 0.0
        return GnssFix(
            t_s=self.t_s, lat_deg=math.degrees(y_m / WGS84_A_M),
            lon_deg=math.degrees(x_m / WGS84_A_M), alt_m=0.0, pos_std_m=0.01,
            quality=self.quality, velocity_mps=velocity if self.has_velocity else None,
        )  # fmt: skip


@pytest.mark.parametrize("has_velocity", [True, False])
@pytest.mark.parametrize(
    ("quality", "within_s"), [(GnssQuality.RTK_FIXED, 4.0), (GnssQuality.SINGLE, 7.0)]
)
def test_a_robot_whose_wheels_turn_in_mud_is_told_to_be_stuck_within_seconds(
    quality: GnssQuality, within_s: float, has_velocity: bool
) -> None:
    ride = Ride(quality)
    ride.has_velocity = has_velocity
    assert ride.go(10.0) is None
    ride.kept_ratio, begun_s = 0.02, ride.t_s
    assert isinstance(ride.go(10.0), Stuck)
    assert ride.t_s - begun_s <= within_s


def test_a_clod_that_holds_the_robot_for_two_seconds_is_climbed_and_no_fault() -> None:
    ride = Ride()
    for _ in range(5):
        ride.kept_ratio = 0.8
        assert ride.go(4.0) is None
        ride.kept_ratio = 0.0
        assert ride.go(2.0) is None


@pytest.mark.parametrize("kept_ratio", [0.5, 0.7, 1.3])
@pytest.mark.parametrize("turn_radps", [0.0, 0.6, -1.0])
def test_slip_that_leaves_half_of_the_way_is_no_fault_on_any_curve(
    kept_ratio: float, turn_radps: float
) -> None:
    ride = Ride()
    ride.kept_ratio, ride.turn_radps = kept_ratio, turn_radps
    assert ride.go(30.0) is None


@pytest.mark.parametrize(
    ("turn_radps", "kept_ratio", "slide_rad", "back_ratio", "bogged_s"),
    [(-0.4, 0.5, 1.0, 0.0, 0.4), (-0.8, 0.5, 1.3, 0.4, 0.2), (-0.8, 0.6, 1.0, 0.0, 0.4)],
)
def test_a_robot_that_got_out_of_a_soft_place_by_itself_is_not_told_to_be_stuck(
    turn_radps: float, kept_ratio: float, slide_rad: float, back_ratio: float, bogged_s: float
) -> None:
    """It slides out of a curve, bogs down or rolls back for a moment, and gets on again."""
    ride = Ride()
    assert ride.go(5.0) is None
    ride.turn_radps, ride.kept_ratio, ride.slide_rad = turn_radps, kept_ratio, slide_rad
    assert ride.go(0.5) is None
    ride.kept_ratio = -back_ratio
    assert ride.go(bogged_s) is None
    ride.kept_ratio, ride.slide_rad = 0.7, 0.0
    assert ride.go(8.0) is None
    ride.kept_ratio = 0.02
    assert isinstance(ride.go(4.0), Stuck), "a robot without headway is reported"


def test_wheels_that_turn_against_each_other_end_what_was_before() -> None:
    """A robot that breaks loose on the spot is judged by its way from then on."""
    ride = Ride()
    ride.go(5.0)
    for _ in range(4):
        ride.kept_ratio = 0.0
        assert ride.go(0.5) is None
        ride.is_on_spot = True
        assert ride.go(0.8) is None
        ride.is_on_spot, ride.kept_ratio = False, 0.6
        assert ride.go(1.0) is None
    ride.kept_ratio = 0.0
    assert isinstance(ride.go(4.0), Stuck)


def test_a_receiver_that_repeats_itself_jumps_or_falls_silent_is_no_sign_of_mud() -> None:
    ride = Ride()
    ride.go(5.0)
    ride.is_frozen = True
    assert ride.go(10.0) is None, "its velocity still says that the robot gets on"
    ride = Ride()
    ride.go(5.0)
    for shift_m in (-0.4, 0.4, -2.0):
        ride.shift_m = shift_m
        assert ride.go(5.0) is None
    ride = Ride()
    ride.go(2.0)
    for _ in range(500):  # it is moved on while its receiver is silent
        assert ride.watch.watch(ride.batch(False)) is None
    ride.x_m = 0.8
    assert ride.go(0.1) is None


@pytest.mark.parametrize("off_rad", [1.0, 20.0, 1e9])
def test_a_spoilt_number_of_an_encoder_is_no_way(off_rad: float) -> None:
    ride = Ride()
    ride.go(3.0)
    for _ in range(20):
        spoilt = ride.batch(True)
        a, b, c, d = spoilt.wheels[0].angle_rad
        wheel = msgspec.structs.replace(spoilt.wheels[0], angle_rad=(a + 4.0 * off_rad, b, c, d))
        assert ride.watch.watch(msgspec.structs.replace(spoilt, wheels=(wheel,))) is None
        assert ride.go(0.1) is None


def test_a_mission_in_mud_is_stopped_and_a_hand_is_not() -> None:
    gate, ride = Gate().cruise(), Ride()
    ride.t_s, ride.kept_ratio = gate.rover.t_s, 0.0
    for tick in range(300):
        fix = ride.batch(tick % 5 == 0).gnss
        batch = msgspec.structs.replace(gate.rover.batch(), t_s=gate.rover.t_s + TICK_S, gnss=fix)
        sent, reason = gate.send(batch=batch)
    assert_stopped(sent, reason, StopToClear, Stuck)
    gate.send(actions=("clear_stop",), state="paused")
    for _ in range(50):
        fix = ride.batch(True).gnss
        batch = msgspec.structs.replace(gate.rover.batch(), t_s=gate.rover.t_s + TICK_S, gnss=fix)
        sent, reason = gate.send(batch=batch, state="paused", is_by_hand=True)
    assert reason is None
    assert sent.drive.v_mps > 0.0


def test_a_place_by_dead_reckoning_says_nothing_of_where_the_robot_stays() -> None:
    ride = Ride()
    ride.kept_ratio = 0.0
    for tick in range(1000):
        batch = ride.batch(tick % 5 == 0)
        fixes = [msgspec.structs.replace(one, unmeasured="dead reckoning") for one in batch.gnss]
        assert ride.watch.watch(msgspec.structs.replace(batch, gnss=tuple(fixes))) is None
