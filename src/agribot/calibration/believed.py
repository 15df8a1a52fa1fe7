"""The robot as its description has it, with what was measured of this very one."""

from __future__ import annotations

import msgspec
import numpy as np

from agribot.config import CalibrationConfig
from agribot.errors import DescriptionError
from agribot.robot import Joint, RobotSpec


def calibrated(robot: RobotSpec, measured: CalibrationConfig) -> RobotSpec:
    """The same robot where nothing was measured.

    Raises: DescriptionError: an antenna that is measured but hangs on no joint.
    """
    drive = robot.drive
    if measured.wheel_radius_m is not None:
        drive = msgspec.structs.replace(drive, wheel_radius_m=measured.wheel_radius_m)
    if measured.yaw_multiplier is not None:
        drive = msgspec.structs.replace(drive, yaw_multiplier=measured.yaw_multiplier)
    if drive is not robot.drive:
        robot = msgspec.structs.replace(robot, drive=drive)
    return robot if measured.antenna_m is None else _with_antenna(robot, measured.antenna_m)


def _with_antenna(robot: RobotSpec, antenna_m: tuple[float, float]) -> RobotSpec:
    link = robot.gnss.link
    index = next((i for i, joint in enumerate(robot.joints) if joint.child == link), None)
    if index is None:
        raise DescriptionError(
            f"calibration.antenna_m = {list(antenna_m)}: the antenna's link '{link}' of robot "
            f"'{robot.name}' hangs on no joint; give it a link of its own, or leave the setting out"
        )
    joint = robot.joints[index]
    joints = (*robot.joints[:index], _moved(robot, joint, antenna_m), *robot.joints[index + 1 :])
    return msgspec.structs.replace(robot, joints=joints)


def _moved(robot: RobotSpec, joint: Joint, antenna_m: tuple[float, float]) -> Joint:
    """The height stays; the parent may be turned against the base."""
    base_from_link = robot.base_from_link(joint.child)
    shift_m = np.array([*(np.array(antenna_m) - base_from_link[:2, 3]), 0.0])
    shift_m = robot.base_from_link(joint.parent)[:3, :3].T @ shift_m
    x_m, y_m, z_m = (np.array(joint.origin.xyz_m) + shift_m).tolist()
    origin = msgspec.structs.replace(joint.origin, xyz_m=(x_m, y_m, z_m))
    return msgspec.structs.replace(joint, origin=origin)
