"""What a page asks before it sends the robot to a place."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response

from agribot.core.json_number import is_number
from agribot.ui.answers import (
    Unusable,
    asked_of_robot,
    is_robot_shown,
    json_answer,
    json_body,
    need_operator,
)


async def preview(request: Request) -> Response:
    """The way to `x`, `y` (m, map) with `yaw` (rad) or null; nothing moves."""
    need_operator(request)
    if not is_robot_shown(request):
        raise Unusable(409, "no robot is shown that could drive there")
    goal = await json_body(request)
    yaw = goal.get("yaw")
    numbers = [goal.get("x"), goal.get("y"), *([] if yaw is None else [yaw])]
    if not all(map(is_number, numbers)):
        raise Unusable(400, "a goal needs finite numbers x, y (m, map) and yaw (rad) or null")
    return json_answer(await asked_of_robot(request, "preview_goal", numbers))


ROUTES = (("POST", "/api/v1/goal/preview", preview),)
