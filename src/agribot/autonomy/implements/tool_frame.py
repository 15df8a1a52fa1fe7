"""Plants as seen from the tool point: now, and when a command given now will take effect."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from agribot.core.implement.plants import KnownPlant, PlantMap
from agribot.core.messages import Estimate, PlantClass
from agribot.core.pose import Pose2

SEEN_AHEAD_M = 1.0  # distance of the last sight of a plant from the tool


class Placed(NamedTuple):
    """A plant at `x_m` ahead of the tool point and `y_m` to the left of it."""

    plant: KnownPlant
    x_m: float
    y_m: float


class ToolPose(NamedTuple):
    """Tool point and heading in the map."""

    x_map_m: float
    y_map_m: float
    yaw_map_rad: float


def find_around(plants: PlantMap, tool: ToolPose, reach_m: float) -> list[KnownPlant]:
    """Find the plants, confirmed or not, in an upright square around the tool point."""
    x_m, y_m, _ = tool
    return list(plants.inside(x_m - reach_m, y_m - reach_m, x_m + reach_m, y_m + reach_m))


def find_crops(plants: PlantMap, tool: ToolPose, reach_m: float) -> list[KnownPlant]:
    around = find_around(plants, tool, reach_m)
    return [plant for plant in around if plant.plant == PlantClass.CROP]


def find_near(
    estimate: Estimate, plants: PlantMap, tool_x_m: float, ahead_m: float, half_width_m: float
) -> list[Placed]:
    """Plants, confirmed or not, up to `ahead_m` before and behind the tool point."""
    body = Pose2(estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
    x_map_m, y_map_m = body.transform(tool_x_m, 0.0)
    tool = Pose2(x_map_m, y_map_m, estimate.yaw_map_rad)
    # Half sides of the upright rectangle around the turned one, ahead_m by half_width_m.
    east_m = abs(tool.cos) * ahead_m + abs(tool.sin) * half_width_m
    north_m = abs(tool.sin) * ahead_m + abs(tool.cos) * half_width_m
    near: list[Placed] = []
    for plant in plants.inside(
        x_map_m - east_m, y_map_m - north_m, x_map_m + east_m, y_map_m + north_m
    ):
        x_m, y_m = tool.locate(plant.x_map_m, plant.y_map_m)
        if abs(x_m) <= ahead_m:
            near.append(Placed(plant, x_m, y_m))
    return near


def move_on(
    near: Sequence[Placed], estimate: Estimate, tool_x_m: float, delay_s: float
) -> list[Placed]:
    """Move plants to the tool point of `delay_s` later."""
    way_m, turn_rad, course_rad = _predict_way(estimate, delay_s)
    from_x_m = tool_x_m - way_m * math.cos(course_rad)
    from_y_m = -way_m * math.sin(course_rad)
    turn = Pose2(0.0, 0.0, turn_rad)
    moved = [turn.resolve(x_m + from_x_m, y_m + from_y_m) for _, x_m, y_m in near]
    return [
        Placed(plant, x_m - tool_x_m, y_m)
        for (plant, _, _), (x_m, y_m) in zip(near, moved, strict=True)
    ]


def find_spread_m(seen_std_m: float, estimate: Estimate) -> tuple[float, float]:
    """Find 1 sigma, along and across, of a plant's place against the tool that comes to it.

    `seen_std_m` is that of its place seen from the robot. A heading that was off while the plant
    was seen ahead puts it beside the way; an error of the position is the same for both.
    """
    across_m = SEEN_AHEAD_M * estimate.yaw_std_rad
    return seen_std_m, math.hypot(seen_std_m, across_m)


def predict_tool(estimate: Estimate, tool_x_m: float, delay_s: float) -> ToolPose:
    """Predict the tool point `delay_s` later."""
    way_m, turn_rad, course_rad = _predict_way(estimate, delay_s)
    yaw_rad = estimate.yaw_map_rad + turn_rad
    course_map_rad = estimate.yaw_map_rad + course_rad
    return ToolPose(
        estimate.x_map_m + way_m * math.cos(course_map_rad) + math.cos(yaw_rad) * tool_x_m,
        estimate.y_map_m + way_m * math.sin(course_map_rad) + math.sin(yaw_rad) * tool_x_m,
        yaw_rad,
    )


def _predict_way(estimate: Estimate, delay_s: float) -> tuple[float, float, float]:
    """Distance, turn, and course against the heading now."""
    turn_rad = estimate.yaw_rate_radps * delay_s
    way_m = estimate.v_mps * delay_s
    return way_m, turn_rad, estimate.slip_rad + turn_rad / 2.0
