"""The line of a crop row: straight, or an arc of a circle less than half round."""

from __future__ import annotations

import math
from typing import Generic, NamedTuple

import msgspec
import numpy as np

from agribot.core.arithmetic import Number
from agribot.core.messages import FloatArray, Row
from agribot.core.pose import Pose2

SAGITTA_M = 0.001  # chords that stand for an arc keep this close to it


class PlaceOnLine(NamedTuple, Generic[Number]):
    """A place by a line: how far along it, how far left of it, and the line's yaw there."""

    along_m: Number
    left_m: Number
    yaw_rad: Number | float


def project_on_line(
    start_map_m: tuple[float, float],
    yaw_rad: float,
    curvature_radpm: float,
    x_map_m: Number,
    y_map_m: Number,
) -> PlaceOnLine[Number]:
    """Project a place on a line that starts towards `yaw_rad` and bends left by the curvature."""
    ahead_m, left_m = Pose2(*start_map_m, yaw_rad).locate(x_map_m, y_map_m)
    if not curvature_radpm:
        return PlaceOnLine(ahead_m, left_m, yaw_rad)
    # Seen from the centre of the circle, in radii.
    out, on = 1.0 - curvature_radpm * left_m, curvature_radpm * ahead_m
    turned_rad = np.arctan2(on, out)
    off_m = (1.0 - np.hypot(on, out)) / curvature_radpm
    return PlaceOnLine(turned_rad / curvature_radpm, off_m, yaw_rad + turned_rad)


def project_on_row(row: Row, x_map_m: Number, y_map_m: Number) -> PlaceOnLine[Number]:
    """Project a place on the line of a crop row."""
    return project_on_line(
        row.start_map_m, start_yaw_rad(row), row.curvature_radpm, x_map_m, y_map_m
    )  # fmt: skip


def row_length_m(row: Row) -> float:
    turn_rad = _turn_rad(row)
    return turn_rad / row.curvature_radpm if turn_rad else math.dist(row.start_map_m, row.end_map_m)


def chord_yaw_rad(row: Row) -> float:
    """Compute the direction from the first plant to the last one."""
    (x0, y0), (x1, y1) = row.start_map_m, row.end_map_m
    return math.atan2(y1 - y0, x1 - x0)


def start_yaw_rad(row: Row) -> float:
    return chord_yaw_rad(row) - _turn_rad(row) / 2.0


def end_yaw_rad(row: Row) -> float:
    return chord_yaw_rad(row) + _turn_rad(row) / 2.0


def reverse_row(row: Row) -> Row:
    """Return the same line from its other end."""
    return msgspec.structs.replace(
        row,
        start_map_m=row.end_map_m,
        end_map_m=row.start_map_m,
        curvature_radpm=-row.curvature_radpm,
    )


def row_points_map_m(row: Row) -> FloatArray:
    """Return corners of chords from the first to the last plant, (N, 2); two of a straight row."""
    ends = np.array([row.start_map_m, row.end_map_m])
    turn_rad = _turn_rad(row)
    if not turn_rad:
        return ends
    step_rad = math.sqrt(8.0 * SAGITTA_M * abs(row.curvature_radpm))
    count = math.ceil(abs(turn_rad) / step_rad)
    yaw_rad = start_yaw_rad(row) + turn_rad * np.arange(count + 1) / count
    arc = np.stack([np.sin(yaw_rad), -np.cos(yaw_rad)], axis=1) / row.curvature_radpm
    points: FloatArray = ends[0] + arc - arc[0]
    points[-1] = ends[1]
    return points


def _turn_rad(row: Row) -> float:
    half_chord_m = math.dist(row.start_map_m, row.end_map_m) / 2.0
    return 2.0 * math.asin(min(max(row.curvature_radpm * half_chord_m, -1.0), 1.0))
