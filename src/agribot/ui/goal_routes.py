"""What a page asks before it sends the robot to a place."""

from __future__ import annotations

import math
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

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
    if not all(map(_is_number, numbers)):
        raise Unusable(400, "a goal needs finite numbers x, y (m, map) and yaw (rad) or null")
    return json_answer(await asked_of_robot(request, "preview_goal", numbers))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


ROUTES = (("POST", "/api/v1/goal/preview", preview),)
