"""Attitude from the rows of the physics history, each (HISTORY_COLUMNS,)."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.geo import rotation_from_quaternion
from agribot.core.messages import FloatArray, Vec3
from agribot.sim.state import POSITION, QUATERNION


def read_rotation(row: FloatArray) -> FloatArray:
    """Return the rotation `map_from_base`, (3, 3), of one row."""
    w, x, y, z = row[QUATERNION].tolist()
    return rotation_from_quaternion(w, x, y, z)


def rotate(row: FloatArray, vector: Vec3) -> Vec3:
    """Turn a vector from base axes into map axes by the attitude of a row of the history."""
    w, x, y, z = row[QUATERNION].tolist()
    a, b, c = vector
    return (
        (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c,
        2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c,
        2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c,
    )


def read_base_pose(row: FloatArray) -> FloatArray:
    """Return the pose of base_link in the map, `map_from_base`, (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = read_rotation(row)
    pose[:3, 3] = row[POSITION]
    return pose


def read_roll_pitch_yaw(row: FloatArray) -> Vec3:
    """Return the fixed-axis angles of a row of the history, rad; pitch < 0 with the nose up."""
    w, x, y, z = row[QUATERNION].tolist()
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(min(1.0, max(-1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )
