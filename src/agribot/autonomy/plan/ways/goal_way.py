"""A way to a place that somebody points at: around the crop rows, inside the fence."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.plan.ways.approach import RADIUS_M, plan_approach
from agribot.autonomy.plan.ways.certify import certify, find_closest_to_crop
from agribot.autonomy.plan.ways.curves import SPACING_M, Place, Segment, advance, sample
from agribot.autonomy.plan.ways.dubins import find_shortest
from agribot.autonomy.plan.ways.obstacles import NO_OBSTACLES, Obstacles
from agribot.autonomy.plan.ways.waypoints import plan_waypoints
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import BeyondFence, NoWayOffCrop, OnCropThere, ThereAlready
from agribot.core.messages import MapPoint, Path, Row
from agribot.core.pose import Pose2
from agribot.core.refusal import find_fact
from agribot.core.robot import RobotSpec
from agribot.core.row_shape import chord_yaw_rad, row_points_map_m

OUT_OF_ROWS_M = 0.8  # past the ends of the rows, where the robot may turn

FenceBox = tuple[float, float, float, float]  # x_min_m, y_min_m, x_max_m, y_max_m in the map


def plan_to_place(
    goal: Place,
    start_pose: tuple[float, float, float],
    rows: Sequence[Row],
    fence: FenceBox,
    robot: RobotSpec,
    mission: MissionConfig,
    obstacles: Obstacles = NO_OBSTACLES,
) -> Path:
    """Plan from where the robot stands; without a yaw in the goal, any final heading is accepted.

    A goal between the rows is reached from the end of the rows, straight along them.
    Raises: MissionError: beyond the fence, on crop, or no way keeps clear of the crop.
    """
    x_m, y_m, yaw_rad = goal
    check_inside(x_m, y_m, fence)
    if math.dist(start_pose[:2], (x_m, y_m)) < SPACING_M:
        raise MissionError(ThereAlready())
    start = Pose2(*start_pose)
    if not rows:
        if yaw_rad is None:
            return plan_waypoints(((x_m, y_m),), start_pose, robot, mission)
        return sample(start, find_shortest(start, Pose2(x_m, y_m, yaw_rad), RADIUS_M))
    looks = [yaw_rad] if yaw_rad is not None else _list_headings_rad(start, x_m, y_m, rows)
    free = [
        pose for pose in (Pose2(x_m, y_m, look) for look in looks)
        if _measure_clearance_m(pose, rows, robot) >= mission.plant_clearance_m
    ]  # fmt: skip
    if not free:
        raise MissionError(OnCropThere(x_m, y_m))
    straights_m = [_measure_way_out_m(pose, rows) for pose in free]
    entries = [advance(pose, -back_m) for pose, back_m in zip(free, straights_m, strict=True)]
    try:
        chosen, way = plan_approach(start, entries, rows, robot, mission, obstacles)
        path = sample(start, (*way, Segment(straights_m[chosen], 0.0)))
        certify(path, rows, robot, mission.plant_clearance_m)
        obstacles.check(path)
    except MissionError as error:
        raise MissionError(NoWayOffCrop(x_m, y_m, find_fact(error))) from error
    return path


def make_fence(places: Sequence[tuple[float, float]], margin_m: float) -> FenceBox:
    xs, ys = [place[0] for place in places], [place[1] for place in places]
    return min(xs) - margin_m, min(ys) - margin_m, max(xs) + margin_m, max(ys) + margin_m


def check_inside(x_m: float, y_m: float, fence: FenceBox) -> None:
    """Refuse a place beyond the fence. Raises: MissionError: and by how much it is."""
    x_min_m, y_min_m, x_max_m, y_max_m = fence
    beyond_m = max(x_min_m - x_m, x_m - x_max_m, y_min_m - y_m, y_m - y_max_m)
    if beyond_m > 0.0:
        raise MissionError(BeyondFence(x_m, y_m, beyond_m))


def _list_headings_rad(start: Pose2, x_m: float, y_m: float, rows: Sequence[Row]) -> list[float]:
    """Ways to look at the goal that are worth a try: as it is driven to, and along the rows."""
    along_rad = chord_yaw_rad(rows[0])
    return [math.atan2(y_m - start.y_m, x_m - start.x_m), along_rad, along_rad + math.pi]


def _measure_clearance_m(pose: Pose2, rows: Sequence[Row], robot: RobotSpec) -> float:
    standing = sample(advance(pose, -SPACING_M), (Segment(SPACING_M, 0.0),))
    return find_closest_to_crop(standing, robot, rows).clearance_m


def _measure_way_out_m(pose: Pose2, rows: Sequence[Row]) -> float:
    """Measure the way back past the ends of the rows beside the robot; 0 if it is past them."""
    yaw_rad = chord_yaw_rad(rows[0])
    rows_frame = Pose2(0.0, 0.0, yaw_rad)
    ends: list[MapPoint] = [
        rows_frame.resolve(*end) for row in rows for end in row_points_map_m(row).tolist()
    ]
    along, left = [end[0] for end in ends], [end[1] for end in ends]
    here_m, here_left_m = rows_frame.resolve(*pose.xy_m)
    low_m, high_m = min(along) - OUT_OF_ROWS_M, max(along) + OUT_OF_ROWS_M
    is_beside = min(left) - OUT_OF_ROWS_M < here_left_m < max(left) + OUT_OF_ROWS_M
    if not (low_m < here_m < high_m and is_beside):
        return 0.0
    is_up = math.cos(pose.yaw_rad - yaw_rad) > 0.0
    return here_m - low_m if is_up else high_m - here_m
