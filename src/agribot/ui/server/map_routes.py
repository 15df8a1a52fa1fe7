"""Maps for the background, and the panels of a program."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any, TypeVar

import anyio
import anyio.to_thread
import msgspec
from starlette.requests import Request
from starlette.responses import Response

from agribot.core.errors import ConfigError
from agribot.core.facts import NoAnswer
from agribot.gis.map_import import fetch_tile
from agribot.gis.mbtiles import (
    TileWriter,
    describe_map,
    find_maps,
    find_media_type,
    is_address,
    read_live_template,
    read_tile,
)
from agribot.gis.tile_grid import MapTile
from agribot.ui import wire
from agribot.ui.server.answers import (
    Unusable,
    json_answer,
    need_operator,
    need_seat,
    read_body,
    refuse_request,
    who_asks,
)
from agribot.ui.server.hub import ANSWER_S, Hub
from agribot.ui.server.off_the_loop import run_in_thread

T = TypeVar("T")
FETCHES = anyio.CapacityLimiter(6)
NO_TILE = Response(status_code=204, headers={"cache-control": "max-age=3600"})


async def list_maps(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    return json_answer(await run_in_thread(_list_maps, hub.home / "maps"))


def _list_maps(folder: Path) -> list[wire.MapSource]:
    maps = []
    for name, path in find_maps(folder).items():
        try:
            about = {**describe_map(path), "url": f"/tiles/{name}/{{z}}/{{x}}/{{y}}"}
            maps.append(msgspec.convert(about, wire.MapSource))
        except ConfigError:
            continue  # a file copied here by hand that is not a map
    return maps


async def map_tile(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    where = request.path_params
    path = find_maps(hub.home / "maps").get(where["name"])
    if path is None:
        return refuse_request(404, f"no map '{where['name'][:80]}'")
    address = MapTile(where["z"], where["x"], where["y"])
    data = await anyio.to_thread.run_sync(read_tile, path, *address)
    if data is None and is_address(*address):
        data = await anyio.to_thread.run_sync(_fetch_kept_tile, path, address, limiter=FETCHES)
    if data is None:
        return NO_TILE
    headers = {"cache-control": "max-age=86400"}
    return Response(data, media_type=find_media_type(data), headers=headers)


def _fetch_kept_tile(path: Path, address: MapTile) -> bytes | None:
    """Fetch from the server behind a live map, and keep it; None without a tile."""
    template = read_live_template(path)
    if not template:
        return None
    try:
        data = fetch_tile(template, address)
    except (OSError, ValueError):
        return None  # no network on the field: the map shows what was looked at before
    with TileWriter(path, {}) as writer:
        writer.put(*address, data)
    return data


async def list_panels(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    own = await _list_panels(request) if hub.has_robot and not hub.about.recording else []
    return json_answer([*own, *hub.layers.infos()])


async def panel_data(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    outside = hub.layers.read(request.path_params["id"])
    if outside is not None:
        return json_answer(msgspec.Raw(outside))
    question = wire.ReadPanel(panel=request.path_params["id"])
    value: Any = await _ask_program(request, question, Any)
    if isinstance(value, dict) and set(value) == {"base64"}:
        data = base64.b64decode(value["base64"])
        return Response(
            data, media_type=find_media_type(data), headers={"cache-control": "no-store"}
        )
    return json_answer(value)


async def submit_panel(request: Request) -> Response:
    """Press a button: the program decides whether it needs the seat; a form always does."""
    need_operator(request)
    id, values = request.path_params["id"], await read_body(request, dict[str, Any])
    panels = {panel.id: panel for panel in await _list_panels(request)}
    if id not in panels or panels[id].needs_seat is not False:
        need_seat(request)
    hub: Hub = request.app.state.hub
    hub.note(who_asks(request), f"uses panel '{id}'")
    question = wire.SubmitPanel(panel=id, values=values)
    return json_answer(await _ask_program(request, question, wire.PanelReply))


async def _list_panels(request: Request) -> list[wire.PanelInfo]:
    return await _ask_program(request, wire.ListPanels(), list[wire.PanelInfo])


async def _ask_program(request: Request, question: wire.Question, type: type[T]) -> T:
    hub: Hub = request.app.state.hub
    try:
        return await hub.ask(question, type)
    except TimeoutError as error:
        raise Unusable(504, NoAnswer(ANSWER_S)) from error
    except LookupError as error:
        raise Unusable(422, str(error)) from error


ROUTES = (
    ("GET", "/api/v1/maps", list_maps),
    ("GET", "/tiles/{name}/{z:int}/{x:int}/{y:int}", map_tile),
    ("GET", "/api/v1/panels", list_panels),
    ("GET", "/api/v1/panels/{id}", panel_data),
    ("POST", "/api/v1/panels/{id}", submit_panel),
)
