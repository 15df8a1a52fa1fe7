"""A scan becomes few points in the body frame: what stands there, and not the robot itself."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.scan_obstacles import ScanObstacles
from agribot.core.keep_out import BodyBox
from agribot.core.messages import LaserScan, SensorBatch
from agribot.core.robot import Joint, LidarSpec, Link, Origin
from tests.robot_parts import plain_rover

BODY = BodyBox(front_m=0.5, rear_m=0.5, half_width_m=0.4)
TURNED_RAD = 0.5  # the lidar looks to the left by this
MOUNT = Joint(
    name="mast", kind="fixed", parent="base_link", child="mast",
    origin=Origin(xyz_m=(0.3, 0.1, 0.4), rpy_rad=(0.0, 0.0, TURNED_RAD)),
)  # fmt: skip
STEP_RAD = math.radians(0.5)


def read(ranges_m: list[float], min_angle_rad: float) -> list[tuple[float, float]]:
    plain = plain_rover()
    robot = msgspec.structs.replace(
        plain, links=(*plain.links, Link(name="mast")), joints=(*plain.joints, MOUNT),
        lidar=LidarSpec(link="mast"),
    )  # fmt: skip
    scan = LaserScan(
        t_s=1.0, min_angle_rad=min_angle_rad, step_rad=STEP_RAD, range_min_m=0.15,
        range_max_m=12.0, period_s=0.1, ranges_m=np.array(ranges_m),
    )  # fmt: skip
    batch = ScanObstacles(robot, BODY).add(SensorBatch(t_s=1.02, scans=(scan,)))
    (sample,) = batch.obstacles
    assert (sample.t_s, sample.sensor, sample.std_m) == (1.0, "lidar", 0.03)
    return list(sample.points_body_m)


def test_a_return_is_where_the_mount_of_the_lidar_puts_it() -> None:
    (point,) = read([2.0], -TURNED_RAD)
    assert point == pytest.approx((2.3, 0.1), abs=1e-3)
    (point,) = read([2.0], math.pi / 2.0 - TURNED_RAD)
    assert point == pytest.approx((0.3, 2.1), abs=1e-3)


def test_of_each_direction_the_nearest_return_is_kept() -> None:
    points = read([3.0, 2.0, 4.0, math.inf, 5.0, 2.5], -TURNED_RAD + math.radians(0.1))
    away_m = sorted(math.hypot(x - 0.3, y - 0.1) for x, y in points)
    assert away_m == pytest.approx([2.0, 2.5], abs=2e-3)


def test_nothing_far_unmeasured_or_of_the_robot_itself_counts() -> None:
    assert read([9.0, math.inf, math.nan], -TURNED_RAD) == []
    assert read([0.25], -math.pi / 2.0 - TURNED_RAD) == [], "inside of the robot's rectangle"


def test_what_is_too_near_to_be_measured_is_there() -> None:
    assert read([-math.inf], -TURNED_RAD) == [], "of the robot's own front"
    plain = plain_rover()
    robot = msgspec.structs.replace(plain, lidar=LidarSpec(link="base_link"))
    scan = LaserScan(
        t_s=1.0, min_angle_rad=0.0, step_rad=STEP_RAD, range_min_m=0.15, range_max_m=12.0,
        period_s=0.1, ranges_m=np.array([-math.inf]),
    )  # fmt: skip
    short = ScanObstacles(robot, BodyBox(front_m=0.1, rear_m=0.5, half_width_m=0.4))
    (sample,) = short.add(SensorBatch(t_s=1.02, scans=(scan,))).obstacles
    assert sample.points_body_m == ((0.15, 0.0),)


def test_a_batch_without_scans_such_as_of_a_recording_stays_as_it_is() -> None:
    batch = SensorBatch(t_s=1.0)
    robot = msgspec.structs.replace(plain_rover(), lidar=LidarSpec(link="base_link"))
    assert ScanObstacles(robot, BODY).add(batch) is batch
