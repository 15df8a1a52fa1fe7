"""Coverage of a field: row after row, turning on the headlands."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from agribot.autonomy.plan.ways.approach import plan_approach
from agribot.autonomy.plan.ways.curves import MIN_RADIUS_M, Segment, advance, sample
from agribot.autonomy.plan.ways.dubins import find_shortest
from agribot.autonomy.plan.ways.obstacles import NO_OBSTACLES, Obstacles
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import NoRows, RowShort
from agribot.core.messages import Path, Row
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec
from agribot.core.row_shape import (
    chord_yaw_rad,
    end_yaw_rad,
    reverse_row,
    row_length_m,
    start_yaw_rad,
)

MAX_TURN_RADIUS_M = 0.5  # wider pitches get a straight piece, so that the headland stays narrow
# Straight way before the first plant of the first row, m: at least, and between two that are tried.
LEAST_RUN_IN_M, RUN_IN_STEP_M = 0.3, 0.1
NEAR_ENTRY_M = 2.0  # distance from an entry within which a shorter run-in may help, m
SHORT_RUN_IN_COST_M = 0.5  # way that a shorter run-in has to save, m


def plan_rows(
    rows: Sequence[Row],
    start_pose: tuple[float, float, float],
    robot: RobotSpec,
    mission: MissionConfig,
    crop: Sequence[Row] = (),
    obstacles: Obstacles = NO_OBSTACLES,
) -> Path:
    """Drive over every row once, neighbours in alternating direction.

    `start_pose` is (x_map_m, y_map_m, yaw_map_rad). Work begins at the corner of the field that
    is reached first; the path runs `headland_m` past the last plant before each turn, and as far
    towards the first plant unless the robot stands too near for that. The way there keeps off
    `crop`, if more rows stand there than are driven.
    Raises: MissionError: no rows, a row without length, or no clear way from the start.
    """
    if not rows:
        raise MissionError(NoRows())
    for row in rows:
        if math.dist(row.start_map_m, row.end_map_m) < MIN_RADIUS_M:
            raise MissionError(RowShort(row.index, MIN_RADIUS_M))
    start = Pose2(*start_pose)
    ways_in = [
        way
        for ordered in _list_orders(rows)
        for is_first_flipped in (False, True)
        for way in _list_ways_in(_order_passes(ordered, is_first_flipped), start, mission)
    ]
    entries, costs_m = [way.entry for way in ways_in], [way.cost_m for way in ways_in]
    found = plan_approach(start, entries, crop or rows, robot, mission, obstacles, costs_m)
    chosen, way_in = ways_in[found[0]], found[1]
    return sample(start, (*way_in, *_chain_passes(chosen, mission.headland_m)))


def plan_without(
    path: Path,
    index: int,
    skipped: int,
    rows: Sequence[Row],
    robot: RobotSpec,
    mission: MissionConfig,
    obstacles: Obstacles = NO_OBSTACLES,
) -> Path:
    """Keep a path up to its next turn behind point `index`, then drive its other rows but one.

    Raises: MissionError: no clear way leads around the row.
    """
    branch = _find_next_turn(path, index, skipped)
    ahead = set(path.row[branch:].tolist()) - {-1, skipped}
    if not ahead:
        return _join(path, max(branch, 1), None)
    x_m, y_m = path.xy_map_m[branch]
    pose = (float(x_m), float(y_m), float(path.yaw_map_rad[branch]))
    left = [row for row in rows if row.index in ahead]
    return _join(path, branch, plan_rows(left, pose, robot, mission, rows, obstacles))


def _find_next_turn(path: Path, index: int, skipped: int) -> int:
    """Find the end of the straight under the robot; the point itself elsewhere."""
    bends = np.flatnonzero(path.curvature_radpm[index:])
    begin = index + int(bends[0]) if len(bends) else len(path.s_m) - 1
    row = np.flatnonzero(path.row[index:] == skipped)
    return begin if not len(row) or begin < index + int(row[0]) else index


def _join(path: Path, last: int, rest: Path | None) -> Path:
    """Up to and with point `last`, and on along another path that begins there."""
    kept = slice(0, last + 1)
    names = ("xy_map_m", "yaw_map_rad", "curvature_radpm", "row")
    columns = {name: getattr(path, name)[kept] for name in names}
    s_m = path.s_m[kept]
    if rest is not None:
        columns = {
            name: np.concatenate([column[:-1], getattr(rest, name)])
            for name, column in columns.items()
        }
        s_m = np.concatenate([s_m[:-1], s_m[-1] + rest.s_m])
    return Path(**columns, s_m=s_m)


def plan_home(
    rows: Sequence[Row],
    start_pose: tuple[float, float, float],
    home_pose: tuple[float, float, float],
    robot: RobotSpec,
    mission: MissionConfig,
    obstacles: Obstacles = NO_OBSTACLES,
) -> Path:
    """Plan around the rows to a place, and look there as `home_pose` says.

    Raises: MissionError: no such way is clear of the crop.
    """
    start = Pose2(*start_pose)
    _, way = plan_approach(start, [Pose2(*home_pose)], rows, robot, mission, obstacles)
    return sample(start, way)


class _WayIn(NamedTuple):
    """Passes in driving order, the pose at which their path begins, and what it costs, m."""

    passes: list[Row]
    entry: Pose2
    cost_m: float


def _list_ways_in(passes: list[Row], start: Pose2, mission: MissionConfig) -> Iterator[_WayIn]:
    """List the whole run-in, and shorter ones for a robot that stands too near to its beginning."""
    entry = _find_entry(passes, 0, mission.headland_m)
    yield _WayIn(passes, entry, 0.0)
    if math.dist(start.xy_m, entry.xy_m) > NEAR_ENTRY_M:
        return
    count = int((mission.headland_m - LEAST_RUN_IN_M) / RUN_IN_STEP_M + 1e-9)
    for missing_m in (RUN_IN_STEP_M * (number + 1) for number in range(count)):
        yield _WayIn(passes, advance(entry, missing_m), SHORT_RUN_IN_COST_M + missing_m)


def _list_orders(rows: Sequence[Row]) -> list[Sequence[Row]]:
    return [rows] if len(rows) == 1 else [rows, rows[::-1]]


def _order_passes(rows: Sequence[Row], is_first_flipped: bool) -> list[Row]:
    """Put the rows in driving order, each written in its driving direction."""
    passes: list[Row] = []
    for row in rows:
        is_flipped = is_first_flipped
        if passes:
            is_flipped = math.cos(chord_yaw_rad(row) - chord_yaw_rad(passes[-1])) > 0.0
        passes.append(reverse_row(row) if is_flipped else row)
    return passes


def _chain_passes(way_in: _WayIn, headland_m: float) -> list[Segment]:
    pieces: list[Segment] = []
    passes = way_in.passes
    for number, row in enumerate(passes):
        entry = _find_entry(passes, number, headland_m) if number else way_in.entry
        leave = _find_exit(passes, number, headland_m)
        first_plant_m = math.dist((entry.x_m, entry.y_m), row.start_map_m)
        last_plant_m = math.dist((leave.x_m, leave.y_m), row.end_map_m)
        pieces += (
            Segment(first_plant_m, 0.0),
            Segment(row_length_m(row), row.curvature_radpm, row.index),
            Segment(last_plant_m, 0.0),
        )
        if number + 1 < len(passes):
            pieces += _plan_turn(leave, _find_entry(passes, number + 1, headland_m))
    return pieces


def _plan_turn(leave: Pose2, entry: Pose2) -> tuple[Segment, ...]:
    """Semicircle where the pitch allows one; a bulb where it is too narrow for the robot."""
    offset_m = abs(leave.locate(entry.x_m, entry.y_m)[1])
    radius_m = min(max(offset_m / 2.0, MIN_RADIUS_M), MAX_TURN_RADIUS_M)
    return find_shortest(leave, entry, radius_m)


def _find_entry(passes: Sequence[Row], number: int, headland_m: float) -> Pose2:
    """Find the entry before the first plant; rows with uneven ends wait for the longer one."""
    row = passes[number]
    start = Pose2(*row.start_map_m, start_yaw_rad(row))
    extra_m = 0.0
    if number > 0:
        extra_m = max(0.0, -start.locate(*passes[number - 1].end_map_m)[0])
    return advance(start, -headland_m - extra_m)


def _find_exit(passes: Sequence[Row], number: int, headland_m: float) -> Pose2:
    row = passes[number]
    end = Pose2(*row.end_map_m, end_yaw_rad(row))
    extra_m = 0.0
    if number + 1 < len(passes):
        extra_m = max(0.0, end.locate(*passes[number + 1].start_map_m)[0])
    return advance(end, headland_m + extra_m)
