"""Fields and views that the page keeps, files that it takes in, and the plan over a field."""

from __future__ import annotations

from datetime import UTC, datetime
from email import message_from_bytes
from typing import Any

import anyio
import anyio.to_process
import anyio.to_thread
import msgspec
from starlette.requests import Request
from starlette.responses import Response

from agribot.ui.answers import (
    Unusable,
    body,
    json_answer,
    json_body,
    name_of,
    need_operator,
    need_seat,
    refused,
)
from agribot.ui.field_check import check_field, datum_of
from agribot.ui.field_files import read_field_file
from agribot.ui.hub import Hub
from agribot.ui.planning import Wanted, make_plan
from agribot.ui.store import Store

PLAN_TIMEOUT_S = 60.0


def _fields(hub: Hub) -> Store:
    return Store(hub.home / "fields", ".geojson")


def _views(hub: Hub) -> Store:
    return Store(hub.home / "views", ".json")


async def list_fields(request: Request) -> Response:
    return json_answer(_fields(request.app.state.hub).names())


async def get_field(request: Request) -> Response:
    data = _fields(request.app.state.hub).read(request.path_params["name"])
    return Response(data, media_type="application/geo+json")


async def put_field(request: Request) -> Response:
    """Checked before it is stored: a field that cannot be worked never replaces a good one."""
    need_operator(request)
    hub: Hub = request.app.state.hub
    collection = await json_body(request)
    name = request.path_params["name"]
    verdict = await anyio.to_thread.run_sync(check_field, collection, datum_of(hub.about.field))
    if not verdict["ok"]:
        first = verdict["reasons"][0]["text"]
        return json_answer({"error": f"field '{name}' is not stored: {first}", **verdict}, 422)
    _fields(hub).write(name, collection)
    hub.note(name_of(request), f"stores field '{name}'")
    return json_answer(verdict)


async def delete_field(request: Request) -> Response:
    need_operator(request)
    hub: Hub = request.app.state.hub
    _fields(hub).delete(request.path_params["name"])
    hub.note(name_of(request), f"deletes field '{request.path_params['name']}'")
    return Response(status_code=204)


async def import_field(request: Request) -> Response:
    """A file as the body with `?filename=`, or as the first file of a form; nothing is stored."""
    need_operator(request)
    name, data = request.query_params.get("filename", ""), await body(request)
    content_type = request.headers.get("content-type", "")
    if content_type.startswith("multipart/form-data"):
        name, data = _first_file(content_type, data)
    return json_answer(await anyio.to_thread.run_sync(read_field_file, name, data))


def _first_file(content_type: str, data: bytes) -> tuple[str, bytes]:
    message = message_from_bytes(f"Content-Type: {content_type}\r\n\r\n".encode() + data)
    for part in message.walk():
        name = part.get_filename()
        if name:
            payload = part.get_payload(decode=True)
            return name, payload if isinstance(payload, bytes) else b""
    raise Unusable(400, "the form holds no file")


async def check_plan(request: Request) -> Response:
    """Plan and certificate to look at; nothing moves."""
    need_operator(request)
    answer, _ = await _plan(request)
    return json_answer(answer)


async def apply_plan(request: Request) -> Response:
    """Keeps a good plan as a file; a mission that runs is never exchanged under way."""
    need_seat(request)
    hub: Hub = request.app.state.hub
    answer, text = await _plan(request)
    if not answer["ok"]:
        first = answer["reasons"][0]["text"]
        return json_answer({"error": f"the plan is not used: {first}", **answer}, 422)
    path = hub.home / "plans" / f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}.geojson"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    hub.note(name_of(request), f"keeps a plan as {path}")
    return refused(
        501,
        f"a running mission cannot take a new plan; this one is kept as {path}: start it with "
        f"'agribot run {hub.about.profile} --ui --set plan={path}'",
    )


async def _plan(request: Request) -> tuple[dict[str, Any], str]:
    hub: Hub = request.app.state.hub
    try:
        wanted = msgspec.convert(await json_body(request), Wanted)
    except msgspec.ValidationError as error:
        raise Unusable(422, f"the request for a plan is not usable: {error}") from error
    config, robot = hub.about.config, hub.about.robot_spec
    try:
        with anyio.fail_after(PLAN_TIMEOUT_S):
            return await anyio.to_process.run_sync(
                make_plan, wanted, config, robot, cancellable=True
            )
    except TimeoutError as error:
        limit_s = PLAN_TIMEOUT_S
        raise Unusable(504, f"no plan within {limit_s:g} s; give a simpler field") from error


async def list_views(request: Request) -> Response:
    return json_answer(_views(request.app.state.hub).names())


async def get_view(request: Request) -> Response:
    data = _views(request.app.state.hub).read(request.path_params["name"])
    return Response(data, media_type="application/json")


async def put_view(request: Request) -> Response:
    need_operator(request)
    _views(request.app.state.hub).write(request.path_params["name"], await json_body(request))
    return Response(status_code=204)


ROUTES = (
    ("GET", "/api/v1/fields", list_fields),
    ("POST", "/api/v1/fields/import", import_field),
    ("GET", "/api/v1/fields/{name}", get_field),
    ("PUT", "/api/v1/fields/{name}", put_field),
    ("DELETE", "/api/v1/fields/{name}", delete_field),
    ("POST", "/api/v1/plan", check_plan),
    ("POST", "/api/v1/plan/apply", apply_plan),
    ("GET", "/api/v1/views", list_views),
    ("GET", "/api/v1/views/{name}", get_view),
    ("PUT", "/api/v1/views/{name}", put_view),
)
