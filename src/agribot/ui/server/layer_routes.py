"""Layers that programs outside of the robot add to the map."""

from __future__ import annotations

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from agribot.ui import wire
from agribot.ui.server.answers import Unusable, json_answer, need_operator, read_body, who_asks
from agribot.ui.server.hub import Hub
from agribot.ui.server.outside_layers import BadLayer


async def list_layers(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    return json_answer(hub.layers.infos())


async def post_layer(request: Request) -> Response:
    return await _set(request, await read_body(request, wire.OutsideLayer))


async def put_layer(request: Request) -> Response:
    layer = await read_body(request, wire.OutsideLayer)
    return await _set(request, msgspec.structs.replace(layer, name=request.path_params["name"]))


async def delete_layer(request: Request) -> Response:
    need_operator(request)
    hub: Hub = request.app.state.hub
    name = request.path_params["name"]
    if not hub.layers.remove(name):
        raise Unusable(404, f"no layer '{name[:80]}'; load the page again")
    hub.note(who_asks(request), f"removes layer '{name}'")
    return Response(status_code=204)


async def _set(request: Request, layer: wire.OutsideLayer) -> Response:
    need_operator(request)
    hub: Hub = request.app.state.hub
    is_new = layer.name.strip() not in hub.layers.names()
    try:
        id = hub.layers.set(layer)
    except BadLayer as error:
        raise Unusable(422, str(error)) from error
    if is_new:
        hub.note(who_asks(request), f"adds layer '{layer.name.strip()}'")
    return json_answer({"id": id}, 201 if is_new else 200)


ROUTES = (
    ("GET", "/api/v1/layers", list_layers),
    ("POST", "/api/v1/layers", post_layer),
    ("PUT", "/api/v1/layers/{name}", put_layer),
    ("DELETE", "/api/v1/layers/{name}", delete_layer),
)
