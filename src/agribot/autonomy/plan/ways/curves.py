"""Paths as chains of arcs and straight lines, sampled into dense points."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from agribot.core.errors import MissionError
from agribot.core.facts import PathWithoutLength
from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray, Path
from agribot.core.pose import Pose2

SPACING_M = 0.02
SHORTEST_M = 1e-6  # shortest segment; shorter ones are rounding residues of the geometry
# Tighter than this a skid-steer rover digs with its inner wheels instead of rolling.
MIN_RADIUS_M = 0.3

Place = tuple[float, float, float | None]  # x and y in the map, and where to look at the end


class Segment(NamedTuple):
    """A piece of constant curvature (left positive); `row` is the crop row it works, or -1."""

    length_m: float
    curvature_radpm: float
    row: int = -1

    def end(self, start: Pose2) -> Pose2:
        """Return where the segment leads to from a pose."""
        turn_rad = self.length_m * self.curvature_radpm
        if turn_rad == 0.0:
            return advance(start, self.length_m)
        yaw_rad = start.yaw_rad + turn_rad
        radius_m = 1.0 / self.curvature_radpm
        return Pose2(
            start.x_m + radius_m * (math.sin(yaw_rad) - start.sin),
            start.y_m - radius_m * (math.cos(yaw_rad) - start.cos),
            wrap_rad(yaw_rad),
        )


def advance(pose: Pose2, distance_m: float) -> Pose2:
    """Move a pose straight ahead; backwards where the distance is negative."""
    return Pose2(*pose.transform(distance_m, 0.0), pose.yaw_rad)


def length_m(segments: Iterable[Segment]) -> float:
    return sum(segment.length_m for segment in segments)


def find_end_pose(start: Pose2, segments: Iterable[Segment]) -> Pose2:
    for segment in segments:
        start = segment.end(start)
    return start


def sample(start: Pose2, segments: Iterable[Segment]) -> Path:
    """Lay points at most 2 cm apart; the last one is the end of the last segment.

    Raises: MissionError: the segments have no length.
    """
    blocks, pose, done_m = [], start, 0.0
    for segment in segments:
        if segment.length_m < SHORTEST_M:
            continue
        count = max(1, math.ceil(segment.length_m / SPACING_M - 1e-9))
        along_m = np.arange(count, dtype=np.float64) * (segment.length_m / count)
        blocks.append(_sample_segment(pose, segment, along_m, done_m))
        pose, done_m, last = segment.end(pose), done_m + segment.length_m, segment
    if not blocks:
        raise MissionError(PathWithoutLength())
    blocks.append(_sample_segment(pose, last, np.zeros(1), done_m))
    table = np.concatenate(blocks)
    return make_path(table)


def make_path(table: FloatArray) -> Path:
    """Make a path of a table (N, 6): x, y, yaw, curvature, row, s; yaw may run on beyond pi."""
    return Path(
        xy_map_m=np.ascontiguousarray(table[:, :2]),
        yaw_map_rad=np.pi - np.mod(np.pi - table[:, 2], 2.0 * np.pi),
        curvature_radpm=table[:, 3].copy(),
        row=table[:, 4].astype(np.int64),
        s_m=table[:, 5].copy(),
    )


def _sample_segment(
    start: Pose2, segment: Segment, along_m: FloatArray, done_m: float
) -> FloatArray:
    """Columns x, y, yaw, curvature, row, s of the points `along_m` into a segment."""
    curvature = segment.curvature_radpm
    yaw = start.yaw_rad + curvature * along_m
    half_turn = curvature * along_m / 2.0
    chord_m = along_m * np.sinc(half_turn / np.pi)
    table = np.empty((len(along_m), 6))
    table[:, 0] = start.x_m + chord_m * np.cos(start.yaw_rad + half_turn)
    table[:, 1] = start.y_m + chord_m * np.sin(start.yaw_rad + half_turn)
    table[:, 2] = yaw
    table[:, 3] = curvature
    table[:, 4] = segment.row
    table[:, 5] = done_m + along_m
    return table
