"""The way to a place as the mission would plan it now, before anybody asks it to go there."""

from __future__ import annotations

import math
from typing import Any

from agribot.autonomy.plan.task import Task
from agribot.core.errors import MissionError
from agribot.core.messages import Estimate
from agribot.ui.feed import thinned


def preview_goal(
    task: Task, estimate: Estimate, speed_mps: float, numbers: tuple[float, ...]
) -> dict[str, Any]:
    """Way, length and least time to a goal (x, y and perhaps yaw), or why there is none.

    The robot is not told; what it finds once it has stopped may differ by the way it rolled.
    """
    if not estimate.ok or not math.isfinite(estimate.x_map_m + estimate.y_map_m):
        return {"refusal": "the robot does not know where it is"}
    if not task.has_ways:
        return {"refusal": "this mission drives its own path only"}
    x_m, y_m, *yaw_rad = numbers
    try:
        path = task.plan_to(estimate, (x_m, y_m, yaw_rad[0] if yaw_rad else None))
    except MissionError as error:
        return {"refusal": str(error)}
    length_m = float(path.s_m[-1])
    return {
        "xy": thinned(path)["xy"],
        "length_m": round(length_m, 2),
        "time_s": round(length_m / speed_mps, 1),
    }
