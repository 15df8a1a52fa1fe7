"""Poses of SDF elements as matrices, and matrices as URDF origins."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from agribot.core.geo import rotation_from_quaternion, transform
from agribot.core.messages import FloatArray
from agribot.core.robot import Origin
from agribot.description.elements import SourceFile

EULER, QUATERNION = "euler_rpy", "quat_xyzw"  # forms of a rotation in SDF
LEAST_QUATERNION = 1e-6  # shortest length; only the direction counts


def read_pose(element: ET.Element, source: SourceFile, where: str) -> FloatArray:
    """Read `parent_from_element`, (4, 4); the identity where there is no <pose>."""
    pose = element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return np.eye(4)
    where = f"{where} <pose>"
    form = pose.get("rotation_format", EULER)
    if form == QUATERNION:
        return _read_quaternion_pose(pose, source, where)
    if form != EULER:
        raise source.fail(where, f"rotation_format '{form}' is not read; use {EULER}")
    x, y, z, roll, pitch, yaw = source.parse_numbers(pose.text, 6, where)
    if pose.get("degrees", "false").lower() in {"true", "1"}:
        roll, pitch, yaw = math.radians(roll), math.radians(pitch), math.radians(yaw)
    return transform((x, y, z), (roll, pitch, yaw))


def _read_quaternion_pose(pose: ET.Element, source: SourceFile, where: str) -> FloatArray:
    x, y, z, qx, qy, qz, qw = source.parse_numbers(pose.text, 7, f"{where} {QUATERNION}")
    length = math.hypot(qx, qy, qz, qw)
    if length < LEAST_QUATERNION:
        raise source.fail(where, f"the quaternion '{pose.text}' has no length; use 0 0 0 1")
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_quaternion(*(part / length for part in (qw, qx, qy, qz)))
    matrix[:3, 3] = x, y, z
    return matrix


def warn_of_large_angles(root: ET.Element, source: SourceFile) -> None:
    """Warn of angles of a URDF beyond a whole turn, which are most likely degrees."""
    for part in (*root.findall("link"), *root.findall("joint")):
        where = f"{part.tag} '{part.get('name')}' <origin rpy>"
        for origin in part.iter("origin"):
            with source.attempt(origin):
                angles_rad = source.parse_vec3(origin.get("rpy", "0 0 0"), where)
                largest_rad = max(angles_rad, key=abs)
                if abs(largest_rad) <= math.tau + 1e-6:
                    continue
                source.warn(
                    f"{where}: an angle of {largest_rad:g} rad is more than a whole turn, "
                    f"{math.tau:.4g}; angles are in radians: {largest_rad:g} degrees are "
                    f"{math.radians(largest_rad):.4g}",
                    origin,
                )


def extract_yaw(matrix: FloatArray) -> float:
    """Return the yaw of a pose (4, 4) or rotation (3, 3), rad."""
    return math.atan2(matrix[1, 0], matrix[0, 0])


def to_origin(matrix: FloatArray) -> Origin:
    """Convert a pose (4, 4) to the origin whose `matrix()` it is."""
    across = math.hypot(matrix[0, 0], matrix[1, 0])
    pitch = math.atan2(-matrix[2, 0], across)
    if across > 1e-9:
        roll, yaw = math.atan2(matrix[2, 1], matrix[2, 2]), extract_yaw(matrix)
    else:  # looking straight up or down: roll and yaw turn about the same axis
        roll, yaw = 0.0, math.atan2(-matrix[0, 1], matrix[1, 1])
    x, y, z = matrix[:3, 3].tolist()
    return Origin(xyz_m=(x, y, z), rpy_rad=(roll, pitch, yaw))


def make_yaw_rotation(yaw_rad: float) -> FloatArray:
    """Make a rotation about the vertical, (4, 4), exact for whole quarter turns."""
    quarters = yaw_rad / (math.pi / 2)
    if abs(quarters - round(quarters)) < 1e-12:
        cos, sin = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    else:
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.eye(4)
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    return turn
