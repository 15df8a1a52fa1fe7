"""The robot of its description, corrected by what was measured of it."""

from __future__ import annotations

import msgspec
import numpy as np

from agribot.core.config import CalibrationConfig
from agribot.core.errors import DescriptionError
from agribot.core.geo import inverse, rotation_from_rpy, rpy_from_rotation
from agribot.core.robot import Joint, Origin, RobotSpec

# Wear and load change a wheel by some percent: more than these factors is another unit, or another
# robot, and the wheels would turn too fast by that factor.
MOST_RADIUS_RATIO, MOST_YAW_RATIO = 2.0, 4.0


def apply_calibration(robot: RobotSpec, measured: CalibrationConfig) -> RobotSpec:
    """Return the robot with the measured geometry; the same where nothing was measured.

    Raises: DescriptionError: an antenna or a camera that is measured but hangs on no joint, or
    wheels that cannot be those of the description.
    """
    drive = robot.drive
    _check_ratio(robot, "wheel_radius_m", measured, MOST_RADIUS_RATIO)
    _check_ratio(robot, "yaw_multiplier", measured, MOST_YAW_RATIO)
    if measured.wheel_radius_m is not None:
        drive = msgspec.structs.replace(drive, wheel_radius_m=measured.wheel_radius_m)
    if measured.yaw_multiplier is not None:
        drive = msgspec.structs.replace(drive, yaw_multiplier=measured.yaw_multiplier)
    if drive is not robot.drive:
        robot = msgspec.structs.replace(robot, drive=drive)
    if measured.antenna_m is not None:
        robot = _move_antenna(robot, measured.antenna_m)
    return _move_camera(robot, measured)


def _check_ratio(robot: RobotSpec, name: str, measured: CalibrationConfig, most: float) -> None:
    value, described = getattr(measured, name), getattr(robot.drive, name)
    if value is not None and not 1.0 / most <= value / described <= most:
        raise DescriptionError(
            f"calibration.{name} = {value:g}: that of robot '{robot.name}' is {described:g} by its "
            f"description, and measured it can be {described / most:g} to {described * most:g}; "
            "measure it again (agribot calibrate drive), or fix the description"
        )


def _move_antenna(robot: RobotSpec, antenna_m: tuple[float, float]) -> RobotSpec:
    """Move the antenna in the plane; its height stays."""
    link = robot.gnss.link
    joint = _find_joint(robot, link, f"calibration.antenna_m = {list(antenna_m)}: the antenna's")
    shift_m = (*(np.array(antenna_m) - robot.base_from_link(link)[:2, 3]).tolist(), 0.0)
    return _replace_origin(robot, joint, _shift_origin(robot, joint, shift_m))


def _move_camera(robot: RobotSpec, measured: CalibrationConfig) -> RobotSpec:
    """Turn and raise the camera; its place in the ground's plane stays, which no picture shows."""
    height_m, rpy_rad = measured.camera_height_m, measured.camera_rpy_rad
    if height_m is None and rpy_rad is None:
        return robot
    if robot.camera is None:
        raise DescriptionError(
            f"calibration.camera_*: robot '{robot.name}' has no camera; leave the settings out"
        )
    joint = _find_joint(robot, robot.camera.link, "calibration.camera_*: the camera's")
    if rpy_rad is not None:
        parent_from_base = inverse(robot.base_from_link(joint.parent))
        turned = parent_from_base[:3, :3] @ rotation_from_rpy(*rpy_rad)
        origin = msgspec.structs.replace(joint.origin, rpy_rad=rpy_from_rotation(turned))
        robot = _replace_origin(robot, joint, origin)
    if height_m is not None:
        joint = _find_joint(robot, joint.child, "")
        shift_m = (0.0, 0.0, height_m - float(robot.body_from_link(joint.child)[2, 3]))
        robot = _replace_origin(robot, joint, _shift_origin(robot, joint, shift_m))
    return robot


def _find_joint(robot: RobotSpec, link: str, whose: str) -> Joint:
    """Find the joint that carries a link.

    Raises: DescriptionError: none, or that of the whole robot.
    """
    joint = next((joint for joint in robot.joints if joint.child == link), None)
    if joint is None or link == "base_link":
        raise DescriptionError(
            f"{whose} link '{link}' of robot '{robot.name}' hangs on no joint; give it a link of "
            "its own, or leave the setting out"
        )
    return joint


def _shift_origin(
    robot: RobotSpec, joint: Joint, shift_base_m: tuple[float, float, float]
) -> Origin:
    """Shift a joint's origin in the base's axes, against which its parent may be turned."""
    shift_m = robot.base_from_link(joint.parent)[:3, :3].T @ np.array(shift_base_m)
    x_m, y_m, z_m = (np.array(joint.origin.xyz_m) + shift_m).tolist()
    return msgspec.structs.replace(joint.origin, xyz_m=(x_m, y_m, z_m))


def _replace_origin(robot: RobotSpec, joint: Joint, origin: Origin) -> RobotSpec:
    moved = msgspec.structs.replace(joint, origin=origin)
    joints = tuple(moved if each is joint else each for each in robot.joints)
    return msgspec.structs.replace(robot, joints=joints)
