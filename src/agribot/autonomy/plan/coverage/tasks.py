"""What is to be worked, as tasks that can each be driven in several ways, and their order."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from agribot.autonomy.plan.coverage.area import Leg, LegKind, MapLine
from agribot.autonomy.plan.coverage.swaths import Swath, find_drive, rotate
from agribot.autonomy.plan.coverage.turns import BendRadii, smooth
from agribot.core.errors import MissionError
from agribot.core.facts import RowSharp
from agribot.core.messages import FloatArray, MapPoint

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

# A task is its variants; a variant is its working lines in driving order.
WorkingLines = list[FloatArray]
CoverageTask = tuple[LegKind, list[WorkingLines]]
RING_STARTS = 8
ROUTED_CANDIDATES = 4


def make_cell_task(cell: Sequence[Swath], yaw_rad: float, tool_x_m: float) -> CoverageTask:
    """Drive up and down through a cell, begun at any of its four corners."""
    variants = []
    for ordered in (cell, cell[::-1]):
        for first_flipped in (False, True):
            ends = np.array(
                [
                    _list_ends(swath, (number % 2 == 0) == first_flipped, tool_x_m)
                    for number, swath in enumerate(ordered)
                ]
            )
            variants.append(list(rotate(ends.reshape(-1, 2), yaw_rad).reshape(-1, 2, 2)))
    return "swath", variants


def _list_ends(swath: Swath, is_flipped: bool, tool_x_m: float) -> list[MapPoint]:
    """List both ends of the drive along a swath, in the swath frame and in driving order."""
    if is_flipped:
        end_m, start_m = find_drive(swath, -tool_x_m)
    else:
        start_m, end_m = find_drive(swath, tool_x_m)
    return [(start_m, swath.v_m), (end_m, swath.v_m)]


def make_ring_tasks(region: BaseGeometry, around_m: float) -> list[CoverageTask]:
    """Drive once around every edge of a region, begun at any of its first corners.

    A bend around something outside of the region is rounded with at most that radius, which is
    what the region keeps from it, so that the arc does not come nearer.
    """
    import shapely

    tasks: list[CoverageTask] = []
    for part in shapely.get_parts(region):
        for number, ring in enumerate((part.exterior, *part.interiors)):
            is_inside_left = shapely.is_ccw(ring) == (number == 0)
            most = BendRadii(right_m=around_m) if is_inside_left else BendRadii(left_m=around_m)
            pieces = smooth(shapely.get_coordinates(ring), is_closed=True, most=most)
            step = max(1, len(pieces) // RING_STARTS)
            turned = [pieces[k:] + pieces[:k] for k in range(0, len(pieces), step)]
            tasks.append(("headland", turned))
    return tasks


def make_row_task(
    row: MapLine, number: int, measure_beyond_m: Callable[[FloatArray, FloatArray], float]
) -> CoverageTask:
    """Drive along a crop row, and past both ends far enough to turn clear of the crop.

    How far that is, is measured by the last two places of an end.
    """
    xy = np.array(row)
    last = ((xy[1], xy[0]), (xy[-2], xy[-1]))
    ends = [_extend(before, end, measure_beyond_m(before, end)) for before, end in last]
    pieces = smooth(np.concatenate([[ends[0]], xy, [ends[1]]]), is_closed=False)
    if len(pieces) != 1:
        east_m, north_m = pieces[0][-1].tolist()
        raise MissionError(RowSharp(number + 1, east_m, north_m))
    return "row", [[pieces[0]], [pieces[0][::-1]]]


def _extend(before: FloatArray, end: FloatArray, distance_m: float) -> FloatArray:
    step = end - before
    return np.asarray(end + step / np.hypot(*step) * distance_m)


def order_tasks(
    tasks: Sequence[CoverageTask],
    start: MapPoint | None,
    way: Callable[[MapPoint, MapPoint], list[MapPoint]],
) -> list[tuple[int, Leg]]:
    """Take every task once, always the nearest next, as (task, working leg) in driving order.

    Nearness counts the way around obstacles for the few that are nearest as the crow flies.
    """
    remaining = list(range(len(tasks)))
    legs: list[tuple[int, Leg]] = []
    here = start
    while remaining:
        choices = sorted(
            (math.dist(here, variant[0][0]) if here else 0.0, task, number)
            for task in remaining
            for number, variant in enumerate(tasks[task][1])
        )[: ROUTED_CANDIDATES if here else 1]
        if here and len({task for _, task, _ in choices}) > 1:
            choices = [_choose_nearest(here, choices, tasks, way)]
        _, chosen, number = choices[0]
        kind, variants = tasks[chosen]
        legs += [(chosen, Leg(kind=kind, xy_map_m=np.asarray(xy))) for xy in variants[number]]
        last = variants[number][-1][-1]
        here = (float(last[0]), float(last[1]))
        remaining.remove(chosen)
    return legs


def _choose_nearest(
    here: MapPoint,
    choices: Sequence[tuple[float, int, int]],
    tasks: Sequence[CoverageTask],
    way: Callable[[MapPoint, MapPoint], list[MapPoint]],
) -> tuple[float, int, int]:
    """Choose by the length of the way; a way is no shorter than the distance, which is sorted."""
    best = (math.inf, 0, 0)
    for choice in choices:
        if choice[0] > best[0]:
            break
        best = min(best, (_measure_length_m(way(here, _find_entry(tasks, choice))), *choice[1:]))
    return best


def _find_entry(tasks: Sequence[CoverageTask], choice: tuple[float, int, int]) -> MapPoint:
    x_m, y_m = tasks[choice[1]][1][choice[2]][0][0]
    return float(x_m), float(y_m)


def _measure_length_m(points: Sequence[MapPoint]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(points))
