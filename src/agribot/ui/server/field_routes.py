"""Fields and views that the page keeps, files that it takes in, and the plan over a field."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from email import message_from_bytes, message_from_string
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from agribot.core.errors import AgribotError
from agribot.core.messages import TakePlan
from agribot.core.refusal import find_fact
from agribot.gis.field_choice import keep_field, list_fields
from agribot.gis.formats.table import read_field_file, write_field_file
from agribot.ui import wire
from agribot.ui.server.answers import (
    NO_STORE,
    Unusable,
    json_answer,
    need_operator,
    need_seat,
    read_body,
    who_asks,
)
from agribot.ui.server.field_check import check_field, datum_of
from agribot.ui.server.hub import Hub
from agribot.ui.server.languages import language_of, say_in
from agribot.ui.server.mapviz_config import config_of, displays_of
from agribot.ui.server.off_the_loop import run_in_process
from agribot.ui.server.planning import Made, make_plan
from agribot.ui.server.store import Store

PLAN_TIMEOUT_S = 60.0
MAX_PART_HEAD_BYTES = 4_000
Route = tuple[str, str, Callable[[Request], Awaitable[Response]]]  # method, path, what answers


def _fields(request: Request) -> Store:
    return Store(request.app.state.hub.home / "fields", ".geojson")


def _views(request: Request) -> Store:
    return Store(request.app.state.hub.home / "views", ".json")


def _reading(path: str, store: Callable[[Request], Store], media_type: str) -> tuple[Route, ...]:
    """Serve what is kept by name: the names, and one document."""

    async def names(request: Request) -> Response:
        return json_answer(store(request).names())

    async def document(request: Request) -> Response:
        return Response(store(request).read(request.path_params["name"]), media_type=media_type)

    return ("GET", path, names), ("GET", f"{path}/{{name}}", document)


async def put_field(request: Request) -> Response:
    """Check before it is stored: a field that cannot be worked never replaces a good one."""
    need_operator(request)
    hub: Hub = request.app.state.hub
    collection = await read_body(request, dict[str, Any])
    name = request.path_params["name"]
    datum = datum_of(hub.about.field)
    verdict = await run_in_process(check_field, collection, datum, what="field")
    if not verdict.ok:
        error = f"field '{name}' is not stored: {verdict.reasons[0].text}"
        return json_answer(msgspec.structs.replace(verdict, error=error), 422)
    _fields(request).write(name, collection)
    hub.note(who_asks(request), f"stores field '{name}'")
    return json_answer(verdict)


async def delete_field(request: Request) -> Response:
    need_operator(request)
    hub: Hub = request.app.state.hub
    _fields(request).delete(request.path_params["name"])
    hub.note(who_asks(request), f"deletes field '{request.path_params['name']}'")
    return Response(status_code=204)


async def import_field(request: Request) -> Response:
    """Read a file: the body with `?filename=`, or the first file of a form; nothing is stored.

    Of several fields in it, named in `fields` of the answer, `?field=` keeps one.
    """
    need_operator(request)
    name, data = request.query_params.get("filename", ""), await request.body()
    field = request.query_params.get("field", "")
    content_type = request.headers.get("content-type", "")
    form = content_type if content_type.startswith("multipart/form-data") else ""
    try:
        read = await run_in_process(_read_file, name, data, form, field, what="file")
        return Response(read, media_type="application/json", headers=NO_STORE)
    except AgribotError as error:
        raise Unusable(422, find_fact(error)) from error


async def export_field(request: Request) -> Response:
    """Convert the FeatureCollection of the body; `?format=` is an ending such as `.gpkg`."""
    collection = await read_body(request, dict[str, Any])
    suffix = request.query_params.get("format", "")
    try:
        data = await run_in_process(write_field_file, suffix, collection, what="field")
    except AgribotError as error:
        raise Unusable(422, find_fact(error)) from error
    return Response(data, media_type="application/octet-stream")


def _read_file(name: str, data: bytes, form: str, field: str) -> bytes:
    """Read the FeatureCollection in a file, as JSON; `form` is the type of a form around it."""
    if form:
        name, data = find_file_in_form(form, data)
    root = read_field_file(name, data)
    fields = list_fields(root)
    if field:
        root = keep_field(root, field, f"'{name[:80]}'")
    root.pop("parts", None)
    return msgspec.json.encode({**root, "fields": fields} if len(fields) > 1 else root)


def find_file_in_form(content_type: str, data: bytes) -> tuple[str, bytes]:
    """Find name and content of the first file of a form; one inside of it is not opened (RFC 7578).

    Raises: Unusable: the form holds no file.
    """
    boundary = message_from_string(f"Content-Type: {content_type}\n\n").get_boundary()
    if not boundary:
        raise Unusable(
            400, "the form names no boundary between its parts; send multipart/form-data"
        )
    for part in (b"\r\n" + data).split(b"\r\n--" + boundary.encode())[1:-1]:
        head, _, payload = part.removeprefix(b"\r\n").partition(b"\r\n\r\n")
        if name := message_from_bytes(head[:MAX_PART_HEAD_BYTES]).get_filename():
            return name, payload
    raise Unusable(400, "the form holds no file; choose one")


async def check_plan(request: Request) -> Response:
    """Plan and certificate to look at; nothing moves."""
    need_operator(request)
    return json_answer((await _plan(request)).answer)


async def apply_plan(request: Request) -> Response:
    """Make a good plan the mission of a robot that stands; it does not set off by itself."""
    need_seat(request)
    hub: Hub = request.app.state.hub
    made = await _plan(request)
    if made.field is None:
        error = f"the plan is not used: {made.answer.reasons[0].text}"
        return json_answer(msgspec.structs.replace(made.answer, error=error), 422)
    refusal = await hub.request(TakePlan(geojson=made.text), who_asks(request))
    if refusal:
        raise Unusable(409, refusal)
    if made.is_crop_gone:
        hub.note(who_asks(request), "takes the crop rows off the map")
    hub.about.field = made.field
    hub.send_to_all(wire.FieldChange())
    return json_answer(made.answer)


async def _plan(request: Request) -> Made:
    hub: Hub = request.app.state.hub
    wanted = await read_body(request, wire.PlanWish, 422)
    config, robot, crop = hub.about.config, hub.about.robot_spec, hub.about.field.crop_map_m
    made = await run_in_process(
        make_plan, wanted, config, robot, crop, timeout_s=PLAN_TIMEOUT_S, what="field"
    )
    return made._replace(answer=say_in(language_of(request), made.answer))


async def put_view(request: Request) -> Response:
    need_operator(request)
    _views(request).write(request.path_params["name"], await read_body(request, dict[str, Any]))
    return Response(status_code=204)


async def import_view(request: Request) -> Response:
    """Read a configuration of mapviz from the body; nothing is stored."""
    need_operator(request)
    displays = await run_in_process(displays_of, await request.body(), what="file")
    return json_answer(msgspec.convert(displays, wire.ImportedView))


async def export_view(request: Request) -> Response:
    """Write the displays of a view, and what it stays on, as a configuration of mapviz."""
    exported = await read_body(request, wire.ExportedView)
    data = await run_in_process(config_of, exported.displays, exported.view, what="view")
    return Response(data, media_type="application/yaml")


ROUTES: tuple[Route, ...] = (
    *_reading("/api/v1/fields", _fields, "application/geo+json"),
    ("POST", "/api/v1/fields/import", import_field),
    ("POST", "/api/v1/fields/export", export_field),
    ("PUT", "/api/v1/fields/{name}", put_field),
    ("DELETE", "/api/v1/fields/{name}", delete_field),
    ("POST", "/api/v1/plan", check_plan),
    ("POST", "/api/v1/plan/apply", apply_plan),
    *_reading("/api/v1/views", _views, "application/json"),
    ("PUT", "/api/v1/views/{name}", put_view),
    ("POST", "/api/v1/views/import", import_view),
    ("POST", "/api/v1/views/export", export_view),
)
