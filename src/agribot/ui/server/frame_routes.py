"""The camera's frames that an operator keeps, and the small pictures of weeds."""

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
    need_seat,
    who_asks,
)
from agribot.ui.server.hub import Hub


async def save_frame(request: Request) -> Response:
    """Save the newest frame with the network's mask in a folder that trains networks."""
    need_seat(request)
    hub: Hub = request.app.state.hub
    if not is_robot_shown(request):
        raise Unusable(409, NoRobotShown())
    saved = await ask_robot(request, wire.SaveFrame(), wire.KeptFrame)
    hub.note(who_asks(request), f"keeps a frame: {saved.image}")
    return json_answer(saved)


async def weed_picture(request: Request) -> Response:
    """Serve a JPEG of a weed as the camera saw it best; `x-captured-s` says when."""
    hub: Hub = request.app.state.hub
    weed = hub.live.weeds.get(request.path_params["id"])
    if weed is None or not is_robot_shown(request):
        raise Unusable(404, "there are pictures of the weeds of the running robot only; show it")
    question = wire.FindPlantPicture(x_map_m=weed.x_map_m, y_map_m=weed.y_map_m)
    found = await ask_robot(request, question, wire.PlantPictureFile)
    if not found.jpeg:
        raise Unusable(
            404,
            "no picture of it is kept: it was seen too long ago, or before a resume; choose "
            "another",
        )
    headers = {"cache-control": "no-store", "x-captured-s": f"{found.t_s:.2f}"}
    return Response(found.jpeg, media_type="image/jpeg", headers=headers)


ROUTES = (
    ("POST", "/api/v1/frames", save_frame),
    ("GET", "/api/v1/weeds/{id:int}/picture", weed_picture),
)
