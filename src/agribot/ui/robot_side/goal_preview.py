"""The way to a place as the mission would plan it now, before anybody asks it to go there."""

from __future__ import annotations

import math

from agribot.autonomy.plan.mission.errand import make_goal_errand
from agribot.autonomy.plan.mission.task import Task
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import PositionLost
from agribot.core.messages import Estimate
from agribot.ui import wire
from agribot.ui.view import thin_path


def preview_goal(
    task: Task, estimate: Estimate, config: MissionConfig, goal: wire.GoTo
) -> wire.GoalPreview:
    """Way, length and least time to a goal.

    The robot gets no command; its way from standstill may differ by the distance it rolls out.
    Raises: MissionError: there is no way; the text says why.
    """
    if not estimate.ok or not math.isfinite(estimate.x_map_m + estimate.y_map_m):
        raise MissionError(PositionLost(estimate.fact))
    path = make_goal_errand(task, "page", goal.place).plan_route(estimate, config).path
    length_m = float(path.s_m[-1])
    return wire.GoalPreview(
        points_map_m=thin_path(path).points_map_m,
        length_m=round(length_m, 2),
        time_s=round(length_m / config.speed_mps, 1),
    )
