"""Maps for the background, and the panels of a program."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import anyio
import anyio.to_thread
from starlette.requests import Request
from starlette.responses import Response

from agribot.core.errors import ConfigError
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
from agribot.gis.tile_grid import Tile
from agribot.ui.answers import (
    Unusable,
    json_answer,
    json_body,
    name_of,
    need_operator,
    need_seat,
    refused,
)
from agribot.ui.hub import Hub
from agribot.ui.off_the_loop import run_in_thread

FETCHES = anyio.CapacityLimiter(6)
NO_TILE = Response(status_code=204, headers={"cache-control": "max-age=3600"})


async def list_maps(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    return json_answer(await run_in_thread(_described_maps, hub.home / "maps"))


def _described_maps(folder: Path) -> list[dict[str, Any]]:
    maps = []
    for name, path in find_maps(folder).items():
        try:
            maps.append({**describe_map(path), "url": f"/tiles/{name}/{{z}}/{{x}}/{{y}}"})
        except ConfigError:
            continue  # a file that somebody put there by hand and that is none
    return maps


async def map_tile(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    where = request.path_params
    path = find_maps(hub.home / "maps").get(where["name"])
    if path is None:
        return refused(404, f"no map '{where['name'][:80]}'")
    address = Tile(where["z"], where["x"], where["y"])
    data = await anyio.to_thread.run_sync(read_tile, path, *address)
    if data is None and is_address(*address):
        data = await anyio.to_thread.run_sync(_fetched, path, address, limiter=FETCHES)
    if data is None:
        return NO_TILE
    headers = {"cache-control": "max-age=86400"}
    return Response(data, media_type=find_media_type(data), headers=headers)


def _fetched(path: Path, address: Tile) -> bytes | None:
    """From the server behind a live map, kept for the next time; None where there is none."""
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
    return json_answer([] if hub.about.recording else await _asked(request, "panels", None))


async def panel_data(request: Request) -> Response:
    value = await _asked(request, "panel_data", {"id": request.path_params["id"]})
    if isinstance(value, dict) and set(value) == {"base64"}:
        data = base64.b64decode(value["base64"])
        return Response(
            data, media_type=find_media_type(data), headers={"cache-control": "no-store"}
        )
    return json_answer(value)


async def submit_panel(request: Request) -> Response:
    """The program decides whether a button needs the seat; a form always does."""
    need_operator(request)
    id, values = request.path_params["id"], await json_body(request)
    panels = {panel["id"]: panel for panel in await _asked(request, "panels", None)}
    if panels.get(id, {}).get("needs_seat", True):
        need_seat(request)
    hub: Hub = request.app.state.hub
    hub.note(name_of(request), f"uses panel '{id}'")
    return json_answer(await _asked(request, "panel_submit", {"id": id, "values": values}))


async def _asked(request: Request, name: str, values: object) -> Any:
    hub: Hub = request.app.state.hub
    try:
        return await hub.ask(name, values)
    except TimeoutError as error:
        raise Unusable(504, "the program did not answer within 10 s") from error
    except LookupError as error:
        raise Unusable(422, str(error)) from error


ROUTES = (
    ("GET", "/api/v1/maps", list_maps),
    ("GET", "/tiles/{name}/{z:int}/{x:int}/{y:int}", map_tile),
    ("GET", "/api/v1/panels", list_panels),
    ("GET", "/api/v1/panels/{id}", panel_data),
    ("POST", "/api/v1/panels/{id}", submit_panel),
)
