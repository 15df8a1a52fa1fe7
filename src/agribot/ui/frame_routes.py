"""The camera's frames that an operator keeps."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response

from agribot.ui.answers import (
    Unusable,
    asked_of_robot,
    channel_of,
    json_answer,
    name_of,
    need_seat,
)
from agribot.ui.hub import Hub

WITHOUT_ROBOT = ("replay", "description")


async def save_frame(request: Request) -> Response:
    """The newest frame with the network's mask, into a folder that trains networks."""
    need_seat(request)
    hub: Hub = request.app.state.hub
    if channel_of(request) is not hub.live or hub.live.source in WITHOUT_ROBOT:
        raise Unusable(409, "no robot is shown whose camera could be kept")
    saved = await asked_of_robot(request, "save_frame", None)
    hub.note(name_of(request), f"keeps a frame: {saved['image']}")
    return json_answer(saved)


ROUTES = (("POST", "/api/v1/frames", save_frame),)
