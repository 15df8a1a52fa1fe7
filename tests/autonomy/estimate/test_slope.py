"""On a slope: the heading of a robot that turns, its tilt in the turn, and where it slides to."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from agribot.autonomy.estimate.filter.ekf import YAW, Ekf, X, Y
from agribot.autonomy.estimate.filter.history import Motion
from agribot.autonomy.estimate.filter.odometry import Odometry
from agribot.autonomy.estimate.sensors.correction import Ladder
from agribot.autonomy.estimate.sensors.crop_rows import CropRows
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.core.config import EstimateConfig, FieldConfig, MissionConfig
from agribot.core.messages import FloatArray, GroundPlant, ImuSample, PlantClass, Scene, WheelSample
from tests.autonomy.estimate.paper_robot import robot

DT_S, RATE_RADPS, GRAVITY_MPS2 = 0.01, 0.6, 9.8
DRIVE = robot().drive


def _attitude(slope_deg: float, turned_rad: float) -> FloatArray:
    """Map axes of a body on a plane that falls to the East, turned on it from looking North."""
    slope = math.radians(slope_deg)
    downhill = np.array([math.cos(slope), 0.0, -math.sin(slope)])
    level, normal = np.array([0.0, 1.0, 0.0]), np.array([math.sin(slope), 0.0, math.cos(slope)])
    ahead = math.cos(turned_rad) * level - math.sin(turned_rad) * downhill
    return np.stack([ahead, np.cross(normal, ahead), normal], axis=1)


def _turn(slope_deg: float, rate_radps: float, angle_rad: float) -> tuple[float, FloatArray, float]:
    """Heading and slide in the map after a turn on the spot, and the worst error of the tilt."""
    odometry = Odometry(DRIVE, 0.3, Counter())
    spread = DRIVE.effective_separation_m / 2.0 / DRIVE.wheel_radius_m
    yaw_rad, slid_m, worst_rad = math.pi / 2.0, np.zeros(2), 0.0
    settled, count = 300, round(angle_rad / abs(rate_radps) / DT_S)
    for index in range(settled + count):
        t_s, turned_rad = index * DT_S, max(index - settled, 0) * DT_S * rate_radps
        body = _attitude(slope_deg, turned_rad)
        up = body.T @ np.array([0.0, 0.0, 1.0])
        gyro = (0.0, 0.0, rate_radps if index > settled else 0.0)
        x, y, z = (GRAVITY_MPS2 * up).tolist()
        angle_right_rad = spread * turned_rad
        wheels = WheelSample(
            t_s=t_s,
            angle_rad=(angle_right_rad, -angle_right_rad, angle_right_rad, -angle_right_rad),
            speed_radps=(0.0, 0.0, 0.0, 0.0),
        )
        imu = ImuSample(t_s=t_s, gyro_radps=gyro, accel_mps2=(x, y, z))
        for step in odometry.steps([wheels], [imu], t_s):
            if index > settled:
                cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
                forward_m, left_m = step.slide_m
                slid_m += (cos * forward_m - sin * left_m, sin * forward_m + cos * left_m)
                yaw_rad += step.turn_rad
        if index > settled:
            worst_rad = max(worst_rad, float(np.linalg.norm(np.cross(odometry.up_body, up))))
    return yaw_rad, slid_m, worst_rad


@pytest.mark.parametrize("slope_deg", [0.0, 10.0, 20.0])
@pytest.mark.parametrize("rate_radps", [RATE_RADPS, -RATE_RADPS])
def test_half_a_turn_on_a_slope_is_half_a_turn_of_the_heading(
    slope_deg: float, rate_radps: float
) -> None:
    """The gyro's rate about the vertical, integrated, would say 177 degrees on a slope of 10."""
    yaw_rad, _, _ = _turn(slope_deg, rate_radps, math.pi)
    turned_deg = math.degrees(yaw_rad) - 90.0
    assert turned_deg == pytest.approx(math.copysign(180.0, rate_radps), abs=0.5)


def test_the_tilt_does_not_lag_behind_a_turn() -> None:
    _, _, worst_rad = _turn(10.0, RATE_RADPS, math.tau)
    assert math.degrees(worst_rad) < 0.2


def test_a_robot_that_turns_on_a_slope_is_expected_to_slide_downhill_and_on_the_level_not() -> None:
    _, level_m, _ = _turn(0.0, RATE_RADPS, math.pi)
    assert not level_m.any()
    # The simulator's rover slides by 0.34 to 0.38 m, and outwards if it faces downhill on the way:
    # see tests/sim/test_slopes.py.
    scale = DRIVE.wheelbase_m / 0.5038
    for rate_radps, outwards_m in ((-RATE_RADPS, 0.18), (RATE_RADPS, -0.18)):
        _, slid_m, _ = _turn(10.0, rate_radps, math.pi)
        assert slid_m[0] == pytest.approx(0.36 * scale, abs=0.04)
        assert slid_m[1] == pytest.approx(outwards_m * scale, abs=0.03)


@pytest.mark.parametrize("std_m", [0.2, MissionConfig().max_row_std_m - 0.01])
def test_a_robot_that_may_still_drive_still_uses_the_crop(std_m: float) -> None:
    """A robot that ignores the crop is more likely to lose the row, as after a turn on a slope."""
    ekf = Ekf([std_m, std_m, 0.02, *[1e-3] * 7, 0.0], row_yaw_rad=math.pi / 2.0)
    field = FieldConfig(plant_spacing_m=2.0)
    ekf.x[X], ekf.x[Y], ekf.x[YAW] = 3.0 + 0.1, 4.0, math.pi / 2.0
    pose = PoseFilter(EstimateConfig(), field, robot(), ekf)
    pose.known.add("position")
    crop = Ladder("scene", CropRows(pose))
    for index in range(20):
        t_s, ahead_m = 0.1 * index, 0.04 * index
        pose.history.append(Motion(t_s, 0.0, ahead_m, 0.0, 0.4, 0.0))
        ekf.x[Y] = 4.0 + ahead_m
        # The third row lies 10 cm to the left of where the robot believes to be, and is under it.
        plant = GroundPlant(
            x_body_m=2.0 - ahead_m, y_body_m=0.0, plant=PlantClass.CROP, area_m2=0.05,
            confidence=0.9, std_m=0.03,
        )  # fmt: skip
        crop.update(Scene(t_s=t_s, ready_s=t_s, frame_index=index, plants=(plant,), view_body_m=()))
    assert not pose.rejected["row ambiguous"]
    assert ekf.x[X] == pytest.approx(3.0, abs=0.03)
    assert math.sqrt(ekf.cov[X, X]) < 0.5 * std_m
