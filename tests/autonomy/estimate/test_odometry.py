"""Wheels and IMU merged into steps, and what counts as standing still."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from agribot.autonomy.estimate.filter.odometry import Odometry, Step
from agribot.core.geo import rotation_from_rpy
from agribot.core.messages import ImuSample, Vec3, WheelSample
from tests.autonomy.estimate.paper_robot import HALF_TRACK_M, RADIUS_M, YAW_MULTIPLIER, robot

NOW_S = 10.0
LEVEL: Vec3 = (0.0, 0.0, 9.8)


def odometry() -> Odometry:
    return Odometry(robot().drive, 0.3, Counter())


def wheels(t_s: float, right_radps: float, left_radps: float) -> WheelSample:
    """Readings of wheels that turn at constant speeds since t = 0."""
    speeds = (right_radps, left_radps, right_radps, left_radps)
    angles = (right_radps * t_s, left_radps * t_s, right_radps * t_s, left_radps * t_s)
    return WheelSample(t_s=t_s, angle_rad=angles, speed_radps=speeds)


def imu(t_s: float, rate_radps: float, accel_mps2: Vec3 | None = LEVEL) -> ImuSample:
    return ImuSample(t_s=t_s, gyro_radps=(0.0, 0.0, rate_radps), accel_mps2=accel_mps2)


def run(
    source: Odometry, right_radps: float, left_radps: float, rate_radps: float, last_s: float = 1.0
) -> list[Step]:
    times = [k * 0.01 for k in range(round(last_s * 100) + 1)]
    return list(
        source.steps(
            [wheels(t, right_radps, left_radps) for t in times],
            [imu(t + h, rate_radps) for t in times for h in (-0.005, 0.0)],
            NOW_S,
        )
    )


def test_distance_is_the_mean_of_the_sides_and_the_turn_comes_from_the_gyro() -> None:
    steps = run(odometry(), 6.0, 4.0, 0.3)
    assert sum(s.distance_m for s in steps) == pytest.approx(5.0 * RADIUS_M)
    assert sum(s.turn_rad for s in steps) == pytest.approx(0.3, rel=1e-3)
    assert not any(s.is_still or s.is_blind for s in steps)


def test_readings_whose_times_differ_by_rounding_are_one() -> None:
    """A clock that leaps back and on gives a time again that differs in its last digits."""
    source = odometry()
    run(source, 6.0, 4.0, 0.3, last_s=0.3)
    again_s = math.nextafter(0.3, 1.0)
    moved = WheelSample(t_s=again_s, angle_rad=(9.0,) * 4, speed_radps=(6.0, 4.0) * 2)
    assert list(source.steps([moved], [], NOW_S)) == []
    (after,) = source.steps([wheels(0.31, 6.0, 4.0)], [], NOW_S)
    assert after.dt_s == pytest.approx(0.01)
    assert after.distance_m == pytest.approx(5.0 * RADIUS_M * 0.01)


def test_an_imu_without_acceleration_turns_the_robot_which_counts_as_level() -> None:
    source = odometry()
    tilted = (0.0, 9.8 * math.sin(0.2), 9.8 * math.cos(0.2))
    times = [k * 0.01 for k in range(201)]
    readings = [imu(t, 0.3, tilted if t < 1.0 else None) for t in times]
    steps = list(source.steps([wheels(t, 6.0, 4.0) for t in times], readings, NOW_S))
    late = [step for step in steps if step.t_s > 1.005]
    assert source.up_body == (0.0, 0.0, 1.0)
    assert sum(s.turn_rad for s in late) == pytest.approx(0.3 * 0.99, rel=0.02)
    assert not any(s.is_blind for s in late)


def test_gyro_samples_between_two_readings_are_averaged() -> None:
    source = odometry()
    first = source.steps([wheels(0.0, 1.0, 1.0)], [imu(0.0, 0.0)], NOW_S)
    assert not list(first)
    (step,) = source.steps([wheels(0.01, 1.0, 1.0)], [imu(0.005, 0.1), imu(0.01, 0.3)], NOW_S)
    assert step.turn_rad == pytest.approx(0.2 * 0.01)


def test_imu_samples_after_the_last_reading_wait_for_the_next_one() -> None:
    source = odometry()
    list(source.steps([wheels(0.0, 1.0, 1.0)], [imu(0.0, 0.0), imu(0.015, 0.7)], NOW_S))
    (early,) = source.steps([wheels(0.01, 1.0, 1.0)], [], NOW_S)
    (late,) = source.steps([wheels(0.02, 1.0, 1.0)], [], NOW_S)
    assert early.turn_rad == 0.0
    assert late.turn_rad == pytest.approx(0.7 * 0.01)


def test_a_gap_without_gyro_takes_the_turn_from_the_wheels_and_says_so() -> None:
    source = odometry()
    run(source, 4.0, 4.0, 0.0)
    after = WheelSample(t_s=2.0, angle_rad=(5.0, 4.0, 5.0, 4.0), speed_radps=(1.0, 0.0, 1.0, 0.0))
    (step,) = source.steps([after], [], NOW_S)
    assert step.is_blind
    assert step.turn_rad == pytest.approx(RADIUS_M / (2 * HALF_TRACK_M * YAW_MULTIPLIER))
    assert step.distance_m == pytest.approx(0.5 * RADIUS_M)


def test_a_gap_of_the_encoders_alone_keeps_the_gyro() -> None:
    source = odometry()
    run(source, 4.0, 4.0, 0.0)
    samples = [imu(1.0 + 0.005 * k, 0.2) for k in range(1, 201)]
    (step,) = source.steps([wheels(2.0, 4.0, 4.0)], samples, NOW_S)
    assert not step.is_blind
    assert step.turn_rad == pytest.approx(0.2)
    assert step.distance_m == pytest.approx(4.0 * RADIUS_M)


def test_standing_needs_quiet_wheels_and_a_quiet_gyro() -> None:
    assert run(odometry(), 0.0, 0.0, 0.01)[-1].is_still
    assert not run(odometry(), 0.0, 0.0, 0.2)[-1].is_still
    assert not run(odometry(), 0.1, -0.1, 0.01)[-1].is_still
    assert not run(odometry(), 0.0, 0.0, 0.01, last_s=0.4)[-1].is_still


def test_standing_measures_the_rate_of_the_gyro_once_per_window() -> None:
    steps = run(odometry(), 0.0, 0.0, 0.01, last_s=2.05)
    rates = [s.zero_rate for s in steps if s.zero_rate is not None]
    assert len(rates) == 4
    for mean_radps, variance in rates:
        assert mean_radps == pytest.approx(0.01)
        assert 0.0 < variance < 1e-6


def test_standing_ends_with_the_first_reading_that_moves() -> None:
    source = odometry()
    assert run(source, 0.0, 0.0, 0.0)[-1].is_still
    moved = WheelSample(t_s=1.01, angle_rad=(0.05,) * 4, speed_radps=(5.0,) * 4)
    (step,) = source.steps([moved], [imu(1.01, 0.0)], NOW_S)
    assert not step.is_still


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(0.0, 10.0), (-12.0, 0.0), (6.0, -7.0)])
def test_vertical_and_turn_are_found_on_a_slope(roll_deg: float, pitch_deg: float) -> None:
    """A turn about the vertical shows on all three gyros of a tilted robot."""
    tilt = rotation_from_rpy(math.radians(roll_deg), math.radians(pitch_deg), 0.0)
    up = tuple((tilt.T @ [0.0, 0.0, 1.0]).tolist())
    source = odometry()
    times = [k * 0.01 for k in range(301)]
    samples = [
        ImuSample(
            t_s=t, gyro_radps=(0.4 * up[0], 0.4 * up[1], 0.4 * up[2]),
            accel_mps2=(9.8 * up[0], 9.8 * up[1], 9.8 * up[2]),
        )
        for t in times
    ]  # fmt: skip
    steps = list(source.steps([wheels(t, 1.0, -1.0) for t in times], samples, NOW_S))
    assert source.up_body == pytest.approx(up, abs=1e-6)
    assert steps[-1].turn_rad == pytest.approx(0.4 * 0.01)


def test_an_imu_that_hides_gravity_counts_as_level() -> None:
    source = odometry()
    list(
        source.steps(
            [wheels(t, 1.0, 1.0) for t in (0.0, 0.01)],
            [imu(t, 0.0, (0.3, 0.1, 0.0)) for t in (0.0, 0.01)],
            NOW_S,
        )
    )
    assert source.up_body == (0.0, 0.0, 1.0)


def test_centripetal_acceleration_does_not_tilt_the_vertical() -> None:
    source = odometry()
    times = [k * 0.01 for k in range(301)]
    speed_mps, rate_radps = 5.0 * RADIUS_M, 0.8
    list(
        source.steps(
            [wheels(t, 5.0, 5.0) for t in times],
            [imu(t, rate_radps, (0.0, speed_mps * rate_radps, 9.8)) for t in times],
            NOW_S,
        )
    )
    assert abs(source.up_body[1]) < 1e-3
