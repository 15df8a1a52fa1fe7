"""The way to a place as the mission would plan it now, before anybody asks it to go there."""

from __future__ import annotations

import math

from agribot.autonomy.plan.task import Task
from agribot.core.errors import MissionError
from agribot.core.messages import Estimate
from agribot.ui import wire
from agribot.ui.view import thin_path


def preview_goal(
    task: Task, estimate: Estimate, speed_mps: float, numbers: tuple[float, ...]
) -> wire.GoalPreview:
    """Way, length and least time to a goal (x, y and perhaps yaw).

    The robot is not told; what it finds once it has stopped may differ by the way it rolled.
    Raises: MissionError: why there is none.
    """
    if not estimate.ok or not math.isfinite(estimate.x_map_m + estimate.y_map_m):
        raise MissionError("the robot does not know where it is")
    if not task.has_ways:
        raise MissionError("this mission drives its own path only")
    x_m, y_m, *yaw_rad = numbers
    path = task.plan_to(estimate, (x_m, y_m, yaw_rad[0] if yaw_rad else None))
    length_m = float(path.s_m[-1])
    return wire.GoalPreview(
        points_map_m=thin_path(path).points_map_m,
        length_m=round(length_m, 2),
        time_s=round(length_m / speed_mps, 1),
    )
