"""Bends that a drive can follow: rounded corners, and turns from one swath into the next."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from agribot.autonomy.plan.coverage.free_space import ROUNDING_M
from agribot.autonomy.plan.ways.curves import (
    MIN_RADIUS_M,
    Segment,
    advance,
    find_end_pose,
    length_m,
)
from agribot.autonomy.plan.ways.dubins import find_shortest
from agribot.core.messages import FloatArray, MapPoint
from agribot.core.pose import Pose2

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

ARC_STEP_M = 0.05
SAME_PLACE_M = 5e-3  # a step shorter than this has no direction to speak of
MAX_ARC_RADIUS_M = 0.5
MAX_ROUNDING_RADIUS_M = 5.0
MAX_SKEW_RAD = 1e-3
SHORTEST_BACK_M = 0.05
MAX_TURN_RAD = 1.5 * math.pi  # largest turn; a larger one is a loop, and looks lost
# A turn in place costs its angle at this rate, stopping and starting, and the straight between.
PIVOT_RATE_RADPS = 0.6
PIVOT_STOP_S = 2.0
TURN_SPEED_MPS = 0.3


def yaw_rad(start: MapPoint | FloatArray, end: MapPoint | FloatArray) -> float:
    """Return the course from one place (2,) to another."""
    return math.atan2(end[1] - start[1], end[0] - start[0])


def bend_rad(before: FloatArray, at: FloatArray, after: FloatArray) -> float:
    """Return by how much a line through three places, (2,) each, bends; left positive."""
    return math.remainder(yaw_rad(at, after) - yaw_rad(before, at), math.tau)


def plan_arc_turn(
    start: Pose2, end: Pose2, drivable: BaseGeometry, *, is_wanted: bool
) -> FloatArray | None:
    """Plan a turn from one pose to another, (N, 2), if it is open and wanted or quicker."""
    import shapely

    _, left_m = start.locate(end.x_m, end.y_m)
    radius_m = min(max(abs(left_m) / 2.0, MIN_RADIUS_M * 1.001), MAX_ARC_RADIUS_M)
    segments = find_shortest(start, end, radius_m)
    turned_rad = sum(segment.length_m * abs(segment.curvature_radpm) for segment in segments)
    is_slow = length_m(segments) / TURN_SPEED_MPS > _estimate_pivot_s(start, end)
    if not is_wanted and (turned_rad > MAX_TURN_RAD or is_slow):
        return None
    points = sample_turn(start, segments)
    if len(points) < 2 or not drivable.covers(shapely.LineString(points)):
        return None
    return points


def plan_three_point_turn(
    start: Pose2, end: Pose2, drivable: BaseGeometry
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Plan a quarter circle ahead, straight back, one ahead, (N, 2) each; None where not open.

    It turns between opposite courses that are closer than two radii, and goes no deeper into the
    headland than one.
    """
    import shapely

    ahead_m, left_m = start.locate(end.x_m, end.y_m)
    back_m = 2.0 * MAX_ARC_RADIUS_M - abs(left_m)
    skew_rad = math.remainder(end.yaw_rad - start.yaw_rad - math.pi, math.tau)
    if abs(skew_rad) > MAX_SKEW_RAD or back_m < SHORTEST_BACK_M:
        return None
    quarter = Segment(
        math.pi / 2.0 * MAX_ARC_RADIUS_M, math.copysign(1.0 / MAX_ARC_RADIUS_M, left_m)
    )
    into = (Segment(max(ahead_m, 0.0), 0.0), quarter)
    turned = find_end_pose(start, into)
    backed = advance(turned, -back_m)
    back = np.array([turned.xy_m, backed.xy_m])
    out = sample_turn(backed, (quarter, Segment(max(-ahead_m, 0.0), 0.0)))
    out[-1] = end.xy_m
    way = (sample_turn(start, into), back, out)
    is_open = drivable.covers(shapely.MultiLineString(way))
    return way if is_open else None


def _estimate_pivot_s(start: Pose2, end: Pose2) -> float:
    course = math.atan2(end.y_m - start.y_m, end.x_m - start.x_m)
    turned_rad = abs(math.remainder(course - start.yaw_rad, math.tau))
    turned_rad += abs(math.remainder(end.yaw_rad - course, math.tau))
    straight_s = math.dist(start.xy_m, end.xy_m) / TURN_SPEED_MPS
    return turned_rad / PIVOT_RATE_RADPS + 2.0 * PIVOT_STOP_S + straight_s


def sample_turn(start: Pose2, segments: Iterable[Segment]) -> FloatArray:
    """Lay the ends of straight pieces, and points a few centimetres apart on arcs, (N, 2)."""
    points, pose = [start.xy_m], start
    for segment in segments:
        if segment.length_m < 1e-6:
            continue
        count = 1
        if segment.curvature_radpm != 0.0:
            count = max(2, math.ceil(segment.length_m / ARC_STEP_M))
        for step in range(1, count + 1):
            part = Segment(segment.length_m * step / count, segment.curvature_radpm)
            points.append(part.end(pose).xy_m)
        pose = segment.end(pose)
    return _drop_repeats(np.array(points))


class BendRadii(NamedTuple):
    """The largest radii with which bends to the left and to the right are rounded, m."""

    left_m: float = MAX_ROUNDING_RADIUS_M
    right_m: float = MAX_ROUNDING_RADIUS_M


ANY_BEND = BendRadii()


def smooth(xy: FloatArray, is_closed: bool, most: BendRadii = ANY_BEND) -> list[FloatArray]:
    """Cut a broken line (N, 2) at the corners where the robot must turn in place.

    Slight bends are rounded, at most ROUNDING_M off their corner. A closed ring begins at a
    corner where it has one.
    """
    xy = _drop_repeats(xy)
    if is_closed:
        if np.allclose(xy[0], xy[-1]):
            xy = xy[:-1]
        corners = [
            k
            for k in range(len(xy))
            if not _round_bend(xy[k - 1], xy[k], xy[(k + 1) % len(xy)], most)
        ]
        first = corners[0] if corners else _choose_widest(xy)
        xy = np.concatenate([xy[first:], xy[: first + 1]])
        if not corners:  # begin in the middle of an edge, so that the ring closes straight
            middle = (xy[0] + xy[1]) / 2.0
            xy = np.concatenate([[middle], xy[1:], [middle]])
    pieces, current = [], [xy[0]]
    for k in range(1, len(xy) - 1):
        arc = _round_bend(xy[k - 1], xy[k], xy[k + 1], most)
        if arc:
            current += arc
        else:
            pieces.append(_drop_repeats(np.array([*current, xy[k]])))
            current = [xy[k]]
    pieces.append(_drop_repeats(np.array([*current, xy[-1]])))
    return pieces


def _choose_widest(xy: FloatArray) -> int:
    return int(np.argmax(np.hypot(*(np.roll(xy, -1, axis=0) - xy).T)))


def _drop_repeats(xy: FloatArray) -> FloatArray:
    """Drop points close behind another one; both ends stay where they are."""
    kept = [xy[0]]
    for point in xy[1:]:
        if math.dist(kept[-1], point) > SAME_PLACE_M:
            kept.append(point)
    if len(kept) > 1:
        kept[-1] = xy[-1]
    elif math.dist(xy[0], xy[-1]) > 0.0:
        kept.append(xy[-1])
    return np.array(kept)


def _round_bend(
    before: FloatArray, at: FloatArray, after: FloatArray, most: BendRadii
) -> list[FloatArray]:
    """Points of the arc that replaces a slight bend; none where the robot must pivot."""
    bend = bend_rad(before, at, after)
    if abs(bend) < 1e-9:
        return [at]
    half_tan = abs(math.tan(bend / 2.0))
    room_m = 0.5 * min(math.dist(before, at), math.dist(at, after))
    cut_ratio = 1.0 / math.cos(bend / 2.0) - 1.0
    most_m = most.left_m if bend > 0.0 else most.right_m
    radius_m = min(room_m / half_tan, ROUNDING_M / cut_ratio, most_m)
    if abs(bend) > math.pi / 2.0 or radius_m < MIN_RADIUS_M * 1.05:
        return []
    course = yaw_rad(before, at)
    tangent_m = radius_m * half_tan
    pose = Pose2(at[0] - tangent_m * math.cos(course), at[1] - tangent_m * math.sin(course), course)
    points = sample_turn(pose, [Segment(abs(bend) * radius_m, math.copysign(1.0 / radius_m, bend))])
    return list(points)
