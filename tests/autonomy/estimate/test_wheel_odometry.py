"""Odometry of the wheels alone: where it ends, and how far off it says that it may be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.estimate.filter.wheel_odometry import OdometryReading, WheelOdometry
from agribot.core.messages import FloatArray, WheelSample
from agribot.core.robot import DriveSpec
from tests.autonomy.estimate.paper_robot import robot

DRIVE: DriveSpec = robot().drive


def wheels(t_s: float, v_mps: float, yaw_rate_radps: float) -> WheelSample:
    """What encoders read of a steady twist since t = 0."""
    left, right = DRIVE.wheel_speeds_radps(v_mps, yaw_rate_radps)
    speeds = (right, left, right, left)
    angles = (right * t_s, left * t_s, right * t_s, left * t_s)
    return WheelSample(t_s=t_s, angle_rad=angles, speed_radps=speeds)


def drive(
    v_mps: float, yaw_rate_radps: float, for_s: float, step_s: float = 0.02
) -> list[OdometryReading]:
    odometry = WheelOdometry(DRIVE)
    times = [k * step_s for k in range(round(for_s / step_s) + 1)]
    readings = [odometry.update(wheels(t_s, v_mps, yaw_rate_radps)) for t_s in times]
    return [reading for reading in readings if reading is not None]


def std(reading: OdometryReading) -> FloatArray:
    return np.sqrt(np.diag(np.reshape(reading.pose_cov, (3, 3))))


def test_a_circle_closes_and_half_of_it_is_a_diameter_away() -> None:
    v_mps, rate_radps = 0.4, 0.25
    half = drive(v_mps, rate_radps, math.pi / rate_radps)[-1]
    assert half.y_m == pytest.approx(2.0 * v_mps / rate_radps, rel=1e-2)
    whole = drive(v_mps, rate_radps, math.tau / rate_radps)[-1]
    assert math.hypot(whole.x_m, whole.y_m) < 0.02
    assert whole.v_mps == pytest.approx(v_mps)
    assert whole.yaw_rate_radps == pytest.approx(rate_radps)


def test_the_first_reading_is_the_origin_and_known() -> None:
    first = drive(0.4, 0.0, 0.0)[0]
    assert (first.x_m, first.y_m, first.yaw_rad) == (0.0, 0.0, 0.0)
    assert first.pose_cov == (0.0,) * 9


def test_the_covariance_grows_with_the_way_and_not_with_time() -> None:
    short, long = std(drive(0.4, 0.1, 5.0)[-1]), std(drive(0.4, 0.1, 20.0)[-1])
    assert (long > 1.5 * short).all()
    parked = drive(0.0, 0.0, 100.0)[-1]
    assert parked.pose_cov == (0.0,) * 9


def test_the_covariance_does_not_depend_on_the_rate_of_the_encoders() -> None:
    often, seldom = drive(0.4, 0.2, 10.0, 0.01)[-1], drive(0.4, 0.2, 10.0, 0.1)[-1]
    assert std(often) == pytest.approx(std(seldom), rel=0.02)


def test_the_covariance_is_that_of_robots_that_differ_as_it_says() -> None:
    """Robots with a radius, turn ratio and walk of their own, against the covariance of one."""
    rng = np.random.default_rng(3)
    said = np.reshape(drive(0.4, 0.1, 10.0, 0.1)[-1].pose_cov, (3, 3))
    odometry = WheelOdometry(DRIVE)
    ends = np.array([_drive_another(odometry, rng) for _ in range(1500)])
    spread = ends.std(axis=0)
    assert spread == pytest.approx(np.sqrt(np.diag(said)), rel=0.1)


def _drive_another(odometry: WheelOdometry, rng: np.random.Generator) -> tuple[float, float, float]:
    scale, turn, crab, loss = rng.standard_normal(4) * np.array(odometry._stds)
    x_m = y_m = yaw_rad = 0.0
    distance_m, turn_rad = 0.04, 0.01
    for _ in range(100):
        walk = rng.standard_normal(4)
        side_m = math.sqrt(odometry._walk_m2_per_m * distance_m)
        place_m = math.sqrt(side_m**2 + 0.05**2 * turn_rad)
        turned = turn_rad * (1 + turn) + 2.0 * side_m * walk[0] / DRIVE.effective_separation_m
        ahead = distance_m * (1 + scale) + loss * turn_rad + place_m * walk[1]
        aside = distance_m * crab + place_m * walk[2]
        middle = yaw_rad + turned / 2.0
        x_m += ahead * math.cos(middle) - aside * math.sin(middle)
        y_m += ahead * math.sin(middle) + aside * math.cos(middle)
        yaw_rad += turned
    return x_m, y_m, yaw_rad


def test_readings_that_are_late_repeated_or_no_numbers_are_left_out() -> None:
    odometry = WheelOdometry(DRIVE)
    assert odometry.update(wheels(0.0, 0.4, 0.0))
    before = odometry.update(wheels(1.0, 0.4, 0.0))
    assert odometry.update(wheels(1.0, 0.4, 0.0)) is None
    assert odometry.update(wheels(0.5, 0.4, 0.0)) is None
    assert odometry.update(wheels(math.nan, 0.4, 0.0)) is None
    after = odometry.update(wheels(2.0, 0.4, 0.0))
    assert before and after
    assert after.x_m - before.x_m == pytest.approx(0.4)


def test_an_encoder_that_restarts_from_zero_does_not_throw_the_robot() -> None:
    odometry = WheelOdometry(DRIVE)
    for k in range(51):
        odometry.update(wheels(k * 0.02, 0.4, 0.0))
    restarted = WheelSample(
        t_s=1.02, angle_rad=(0.0,) * 4, speed_radps=wheels(1.0, 0.4, 0.0).speed_radps
    )
    reading = odometry.update(restarted)
    assert reading is not None
    assert reading.x_m == pytest.approx(0.4 * 1.02)


def test_a_parked_robot_knows_its_speed_to_a_tick_of_the_encoder() -> None:
    parked = drive(0.0, 0.0, 1.0)[-1]
    driving = drive(0.4, 0.0, 1.0)[-1]
    assert 0.0 < parked.twist_var[0] < driving.twist_var[0]
    assert parked.twist_var[1] == 0.0
