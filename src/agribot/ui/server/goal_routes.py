"""What a page asks before it sends the robot to a place."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response

from agribot.core.facts import NoRobotShown
from agribot.ui import wire
from agribot.ui.server.answers import (
    Unusable,
    ask_robot,
    is_robot_shown,
    json_answer,
    need_operator,
    read_body,
)


async def preview(request: Request) -> Response:
    """Plan the way to a place, where it matters with a heading there; nothing moves."""
    need_operator(request)
    if not is_robot_shown(request):
        raise Unusable(409, NoRobotShown())
    goal = await read_body(request, wire.GoalPlace)
    there = wire.GoTo(x_map_m=goal.x_map_m, y_map_m=goal.y_map_m, yaw_map_rad=goal.yaw_map_rad)
    question = wire.PreviewGoal(goal=there)
    return json_answer(await ask_robot(request, question, wire.GoalPreview))


ROUTES = (("POST", "/api/v1/goal/preview", preview),)
