"""A camera's mount that was measured: believed by the next run, and nothing else with it."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.app.calibration.measured_robot import apply_calibration
from agribot.core.config import CalibrationConfig
from agribot.core.errors import DescriptionError
from agribot.core.geo import rotation_from_rpy, rpy_from_rotation
from agribot.core.robot import Joint, Link, Origin, RobotSpec
from agribot.description.loader import load_robot

RPY_RAD = (0.03, 0.9, -0.02)
MEASURED = CalibrationConfig(camera_height_m=0.95, camera_rpy_rad=RPY_RAD)


def on_a_turned_mast(robot: RobotSpec) -> RobotSpec:
    """The same place of the camera, on a link that is turned against the base."""
    assert robot.camera is not None
    mast = Link(name="mast")
    turned = Joint(
        name="mast_joint", kind="fixed", parent="base_link", child="mast",
        origin=Origin(xyz_m=(0.1, 0.2, 0.3), rpy_rad=(0.0, 0.0, math.pi / 2.0)),
    )  # fmt: skip
    joints = [
        msgspec.structs.replace(joint, parent="mast") if joint.child == robot.camera.link else joint
        for joint in robot.joints
    ]
    return msgspec.structs.replace(robot, links=(*robot.links, mast), joints=(turned, *joints))


@pytest.mark.parametrize("mounted", [load_robot(), on_a_turned_mast(load_robot())])
def test_the_camera_turns_and_rises_over_its_place_and_nothing_else_moves(
    mounted: RobotSpec,
) -> None:
    moved = apply_calibration(mounted, MEASURED)
    assert mounted.camera is not None
    before, after = (robot.body_from_link(mounted.camera.link) for robot in (mounted, moved))
    np.testing.assert_allclose(after[:2, 3], before[:2, 3], atol=1e-12)
    assert after[2, 3] == pytest.approx(0.95)
    np.testing.assert_allclose(after[:3, :3], rotation_from_rpy(*RPY_RAD), atol=1e-12)
    assert mounted.mag is not None
    for link in (mounted.gnss.link, mounted.imu.link, mounted.mag.link):
        assert np.array_equal(mounted.body_from_link(link), moved.body_from_link(link))


def test_its_height_is_over_the_ground_also_on_wheels_of_another_size() -> None:
    bigger = msgspec.structs.replace(MEASURED, wheel_radius_m=0.12)
    robot = apply_calibration(load_robot(), bigger)
    assert robot.camera is not None
    assert robot.body_from_link(robot.camera.link)[2, 3] == pytest.approx(0.95)


def test_a_robot_without_a_camera_or_a_joint_for_it_says_so() -> None:
    robot = load_robot()
    blind = msgspec.structs.replace(robot, camera=None)
    with pytest.raises(DescriptionError, match="no camera"):
        apply_calibration(blind, MEASURED)
    assert robot.camera is not None
    fixed = msgspec.structs.replace(robot.camera, link="base_link")
    with pytest.raises(DescriptionError, match="hangs on no joint"):
        apply_calibration(msgspec.structs.replace(robot, camera=fixed), MEASURED)


def test_roll_pitch_and_yaw_come_back_from_their_rotation() -> None:
    rng = np.random.default_rng(3)
    for roll, pitch, yaw in rng.uniform(-1.5, 1.5, (50, 3)).tolist():
        back = rpy_from_rotation(rotation_from_rpy(roll, pitch, yaw))
        assert back == pytest.approx((roll, pitch, yaw))
