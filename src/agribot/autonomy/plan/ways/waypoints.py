"""A path through given places: straight legs and rounded corners."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.plan.ways.curves import (
    MIN_RADIUS_M,
    Segment,
    advance,
    find_end_pose,
    length_m,
    sample,
)
from agribot.autonomy.plan.ways.dubins import find_shortest
from agribot.autonomy.plan.ways.waypoint_text import parse_waypoints
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import NoWaypoints, WaypointFar, WaypointsSame
from agribot.core.messages import MapPoint, Path
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec

__all__ = ["parse_waypoints", "plan_waypoints"]

TURN_RADIUS_M = 0.5
MAX_CORNER_RADIUS_M = 1.0
CUT_RATIO = 0.5  # share of the waypoint radius; the other half is left to the follower
SAME_PLACE_M = 0.01
ON_LINE_M = 1e-6
OFF_LINE_COST = 0.3
MAX_RETURN_M = 4.0
RETURN_STEP_M = 0.125

_Leg = tuple[tuple[Segment, ...], float]  # a turn, and the straight distance behind it


def plan_waypoints(
    points_map_m: Sequence[MapPoint],
    start_pose: tuple[float, float, float],
    robot: RobotSpec,
    mission: MissionConfig,
) -> Path:
    """Visit every point in order, each within `waypoint_radius_m`.

    A corner is rounded inside where that passes near enough; else the robot drives through the
    waypoint, turns behind it and returns to the straight line between the waypoints.
    `start_pose` is (x_map_m, y_map_m, yaw_map_rad). Crop is not looked at: certify the path.
    Raises: MissionError: no points, a point repeated, or one too far from the start.
    """
    start = Pose2(*start_pose)
    _check(points_map_m, start, robot, mission)
    pose, pieces = start, list[Segment]()
    for number, point in enumerate(points_map_m):
        if number == 0 and math.dist(start.xy_m, point) <= CUT_RATIO * mission.waypoint_radius_m:
            continue
        turn, straight_m = _plan_turn(pose, point) if number == 0 else _plan_next_leg(pose, point)
        pose = find_end_pose(pose, turn)
        after = points_map_m[number + 1] if number + 1 < len(points_map_m) else None
        leg = _plan_leg(pose.yaw_rad, straight_m, point, after, mission)
        pieces += (*turn, *leg)
        pose = find_end_pose(pose, leg)
    return sample(start, pieces)


def _check(
    points: Sequence[MapPoint], start: Pose2, robot: RobotSpec, mission: MissionConfig
) -> None:
    if not points:
        raise MissionError(NoWaypoints())
    limit_m = mission.max_waypoint_distance_m
    before = (start.x_m, start.y_m)
    for number, point in enumerate(points):
        away_m = math.dist((start.x_m, start.y_m), point)
        if not away_m <= limit_m:
            raise MissionError(WaypointFar(number + 1, robot.name, away_m, limit_m))
        if number > 0 and math.dist(before, point) < SAME_PLACE_M:
            raise MissionError(WaypointsSame(number, number + 1))
        before = point


def _plan_next_leg(pose: Pose2, point: MapPoint) -> _Leg:
    """Turn at a waypoint and get back on the straight line to the next one soon.

    The place of the return is the nearest that needs no loop: every metre off the line costs
    as much as 0.3 m of driving.
    """
    direct = _plan_turn(pose, point)
    line_m = math.dist(pose.xy_m, point)
    if not direct[0]:
        return direct
    line = Pose2(pose.x_m, pose.y_m, math.atan2(point[1] - pose.y_m, point[0] - pose.x_m))
    ways = [(length_m(direct[0]) + direct[1] + OFF_LINE_COST * line_m, direct)]
    for step in range(1, math.floor(min(line_m, MAX_RETURN_M) / RETURN_STEP_M) + 1):
        back_m = step * RETURN_STEP_M
        turn = find_shortest(pose, advance(line, back_m), TURN_RADIUS_M)
        left_m = line_m - back_m
        ways.append((length_m(turn) + left_m + OFF_LINE_COST * back_m, (turn, left_m)))
    return min(ways, key=lambda way: way[0])[1]


def _plan_turn(pose: Pose2, point: MapPoint) -> _Leg:
    """Arc until the point is straight ahead, and the distance that then remains."""
    ahead_m, left_m = pose.locate(*point)
    if abs(left_m) < ON_LINE_M and ahead_m >= 0.0:
        return (), ahead_m
    ways = [way for side in (1.0, -1.0) if (way := _turn_to_side(ahead_m, side * left_m, side))]
    return min(ways, key=lambda way: length_m(way[0]) + way[1])


def _turn_to_side(ahead_m: float, inward_m: float, side: float) -> _Leg | None:
    """Arc to one side (+1 left); None where the point lies inside the turning circle."""
    radius_m = TURN_RADIUS_M
    to_centre_m = math.hypot(ahead_m, radius_m - inward_m)
    if to_centre_m < radius_m - ON_LINE_M:
        return None
    to_centre_m = max(to_centre_m, radius_m)
    straight_m = math.sqrt(to_centre_m * to_centre_m - radius_m * radius_m)
    bearing_rad = math.atan2(ahead_m, radius_m - inward_m)
    turn_rad = (bearing_rad - math.acos(radius_m / to_centre_m)) % math.tau
    return (Segment(turn_rad * radius_m, side / radius_m),), straight_m


def _plan_leg(
    heading_rad: float,
    straight_m: float,
    point: MapPoint,
    after: MapPoint | None,
    mission: MissionConfig,
) -> tuple[Segment, ...]:
    """Straight to the point, or to where the rounding of its corner begins, and round it."""
    corner = _round_corner(heading_rad, straight_m, point, after, mission) if after else None
    if corner is None:
        return (Segment(straight_m, 0.0),)
    return Segment(straight_m - _measure_tangent_m(corner), 0.0), corner


def _round_corner(
    heading_rad: float, straight_m: float, point: MapPoint, after: MapPoint, mission: MissionConfig
) -> Segment | None:
    """Arc that rounds a corner on its inner side; None if it would cut off too much."""
    out_rad = math.atan2(after[1] - point[1], after[0] - point[0])
    bend_rad = math.remainder(out_rad - heading_rad, math.tau)
    if abs(bend_rad) < 1e-6 or abs(bend_rad) > 0.9 * math.pi:
        return None
    cut_per_radius = 1.0 / math.cos(bend_rad / 2.0) - 1.0
    room_m = min(straight_m, math.dist(point, after) / 2.0)
    radius_m = min(
        CUT_RATIO * mission.waypoint_radius_m / cut_per_radius,
        room_m / abs(math.tan(bend_rad / 2.0)),
        MAX_CORNER_RADIUS_M,
    )
    if radius_m < MIN_RADIUS_M:
        return None
    return Segment(abs(bend_rad) * radius_m, math.copysign(1.0 / radius_m, bend_rad))


def _measure_tangent_m(corner: Segment) -> float:
    """Measure the distance from the corner point to either end of its arc."""
    return abs(math.tan(corner.length_m * corner.curvature_radpm / 2.0) / corner.curvature_radpm)
