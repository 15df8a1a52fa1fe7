"""The way from where the robot stands to the first row, around the crop."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import numpy as np

from agribot.autonomy.plan.ways.certify import find_closest_to_crop
from agribot.autonomy.plan.ways.curves import Segment, advance, length_m, sample
from agribot.autonomy.plan.ways.dubins import list_words
from agribot.autonomy.plan.ways.obstacles import NO_OBSTACLES, Obstacles
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import NoClearWay
from agribot.core.messages import Row
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec
from agribot.core.row_shape import (
    chord_yaw_rad,
    end_yaw_rad,
    project_on_row,
    row_length_m,
    row_points_map_m,
    start_yaw_rad,
)

RADIUS_M = 0.5
_RING_MIN_M = 0.8  # half a robot and the clearance beside the outermost row
_MAX_VIAS = 3  # three corners lead once around a field
# Direct ways keep their longer variants too: the shortest may cut across a row.
_WORDS_WHEN_DIRECT = 6

Segments = tuple[Segment, ...]


def plan_approach(
    start: Pose2, entries: Sequence[Pose2], rows: Sequence[Row], robot: RobotSpec,
    mission: MissionConfig, obstacles: Obstacles = NO_OBSTACLES, costs_m: Sequence[float] = (),
) -> tuple[int, Segments]:  # fmt: skip
    """Find the entry that is reached first, by its index, and the shortest clear way to it.

    `costs_m` is way that each entry counts in addition; none without it.

    Raises: MissionError: the robot stands where it cannot leave without crushing crop, or without
        touching an obstacle.
    """
    ways = [
        (length_m(route) + (costs_m[index] if costs_m else 0.0), index, route)
        for index, entry in enumerate(entries)
        for route in _list_ways(start, entry, rows, mission.headland_m, obstacles)
    ]
    for _, index, route in sorted(ways, key=lambda way: way[:2]):
        if length_m(route) < 1e-6:
            return index, ()
        path = sample(start, route)
        closest = find_closest_to_crop(path, robot, rows)
        if closest.clearance_m >= mission.plant_clearance_m and obstacles.are_clear_of(path):
            return index, route
    beside_m = None if obstacles.are_none else obstacles.clearance_m
    raise MissionError(NoClearWay(*start.xy_m, mission.plant_clearance_m, beside_m))


def _list_ways(
    start: Pose2, entry: Pose2, rows: Sequence[Row], headland_m: float, obstacles: Obstacles
) -> Iterator[Segments]:
    yield from list_words(start, entry, RADIUS_M)[:_WORDS_WHEN_DIRECT]
    rings = [_draw_ring(rows, max(headland_m, _RING_MIN_M)), *obstacles.rings()]
    prefixes = [(start,), *((start, way_out) for way_out in _list_exits(start, rows, headland_m))]
    for prefix in prefixes:
        yield _chain_words((*prefix, entry))
    for ring, direction in product(rings, (1, -1)):
        corners = _list_corner_poses(ring, direction)
        for prefix, first in product(prefixes, range(4)):
            vias = [corners[(first + direction * step) % 4] for step in range(_MAX_VIAS)]
            for count in range(1, _MAX_VIAS + 1):
                yield _chain_words((*prefix, *vias[:count], entry))


def _chain_words(poses: Sequence[Pose2]) -> Segments:
    pieces: list[Segment] = []
    for start, end in pairwise(poses):
        pieces += list_words(start, end, RADIUS_M)[0]
    return tuple(pieces)


def _draw_ring(rows: Sequence[Row], margin_m: float) -> list[tuple[float, float]]:
    """Corners of the rectangle along the rows that holds all of them, counter-clockwise."""
    frame = Pose2(0.0, 0.0, chord_yaw_rad(rows[0]))
    ends = np.concatenate([row_points_map_m(row) for row in rows])
    along, left = ends @ np.array(frame.ahead), ends @ np.array(frame.left)
    a0, a1 = float(along.min()) - margin_m, float(along.max()) + margin_m
    l0, l1 = float(left.min()) - margin_m, float(left.max()) + margin_m
    corners = ((a0, l0), (a1, l0), (a1, l1), (a0, l1))
    return [frame.rotate(*corner) for corner in corners]


def _list_corner_poses(ring: Sequence[tuple[float, float]], direction: int) -> list[Pose2]:
    """List a pose at each corner, half turned from the edge it ends to the edge it begins."""
    poses = []
    for index, (x_m, y_m) in enumerate(ring):
        before, after = ring[(index - direction) % 4], ring[(index + direction) % 4]
        yaw_in = math.atan2(y_m - before[1], x_m - before[0])
        yaw_out = math.atan2(after[1] - y_m, after[0] - x_m)
        poses.append(Pose2(x_m, y_m, yaw_in + math.remainder(yaw_out - yaw_in, math.tau) / 2.0))
    return poses


def _list_exits(start: Pose2, rows: Sequence[Row], headland_m: float) -> list[Pose2]:
    """Poses just past both ends of the row under the robot, outwards; none outside the rows."""
    row = min(rows, key=lambda row: abs(project_on_row(row, start.x_m, start.y_m).left_m))
    first = Pose2(*row.start_map_m, start_yaw_rad(row))
    last = Pose2(*row.end_map_m, end_yaw_rad(row))
    along_m, left_m, _ = project_on_row(row, start.x_m, start.y_m)
    if not -headland_m <= along_m <= row_length_m(row) + headland_m or abs(left_m) > 1.0:
        return []
    back = Pose2(first.x_m, first.y_m, first.yaw_rad + math.pi)
    return [advance(last, headland_m), advance(back, headland_m)]
