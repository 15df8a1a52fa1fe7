"""What does not change while the robot runs: session, field, robot; and the weed map's files."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from agribot.core.geo import MapFrame
from agribot.core.version import __version__
from agribot.ui.access import Caller
from agribot.ui.answers import NO_STORE, channel_of, json_answer, refused
from agribot.ui.channel import signal_table
from agribot.ui.field_check import datum_of
from agribot.ui.hub import Hub
from agribot.ui.off_the_loop import run_in_thread
from agribot.ui.replay import Replay

SCREENS = (
    "drive", "teleop", "camera", "weeds", "plan", "plots", "robot", "recordings", "settings",
    "health",
)  # fmt: skip
Row = list[Any]  # a plant as the page reads it
CLASS_NAMES = ("weed", "crop", "soil")
WEED_COLUMNS = (
    "id", "class", "x_map_m", "y_map_m", "std_m", "confidence", "area_m2", "sightings",
    "first_seen_s", "last_seen_s", "treated_s",
)  # fmt: skip


async def session(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    caller: Caller = request.scope["agribot.caller"]
    if caller.role is None:
        return json_answer({"version": __version__, "needs_login": True})
    about = hub.about
    shown = {
        "version": __version__,
        "run": about.run_id,
        "profile": about.profile,
        "source": hub.live.source,
        "role": caller.role,
        "needs_login": False,
        "lan_url": about.lan_url or None,
        "qr_svg": qr_svg(about.lan_url) if about.lan_url and caller.role == "operator" else None,
        "camera": about.robot["camera"] is not None,
        "screens": list(SCREENS),
    }
    return json_answer(shown)


def qr_svg(url: str) -> str:
    """An address as a QR code, for the camera of a tablet."""
    import segno

    buffer = io.BytesIO()
    segno.make(url, error="m").save(buffer, kind="svg", scale=6, xmldecl=False)
    return buffer.getvalue().decode()


async def field(request: Request) -> Response:
    """Of the robot, or of the recording of this name that the caller is shown."""
    hub: Hub = request.app.state.hub
    name = request.query_params.get("recording")
    if name is None:
        return json_answer(hub.about.field)
    shown = channel_of(request)
    if not isinstance(shown, Replay) or shown.name != name:
        return refused(404, f"no recording '{name[:80]}' is shown here")
    return json_answer(shown.field)


async def robot(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    return json_answer(hub.about.robot)


async def robot_file(request: Request) -> Response:
    """The description, its meshes beside it; only files that the description names are served."""
    hub: Hub = request.app.state.hub
    name = request.path_params["name"]
    if name == "robot.urdf":
        return Response(hub.about.urdf, media_type="application/xml")
    path = hub.about.meshes.get(name)
    if path is None or not Path(path).is_file():
        return refused(404, f"the robot has no file '{name[:80]}'")
    headers = {"cache-control": "max-age=3600"}
    return FileResponse(path, media_type="model/stl", headers=headers)


async def topics(request: Request) -> Response:
    table = signal_table()
    pairs = zip(table["names"], table["units"], strict=True)
    return json_answer([{"name": name, "unit": unit, "fields": [name]} for name, unit in pairs])


async def weeds_geojson(request: Request) -> Response:
    return await _weed_file(request, _geojson, "weeds.geojson", "application/geo+json")


async def weeds_csv(request: Request) -> Response:
    return await _weed_file(request, _csv, "weeds.csv", "text/csv")


async def _weed_file(
    request: Request, write: Callable[[list[Row], MapFrame], bytes], name: str, media_type: str
) -> Response:
    hub: Hub = request.app.state.hub
    shown = channel_of(request)
    ground = shown.field if isinstance(shown, Replay) else hub.about.field
    rows, frame = list(shown.weeds.values()), MapFrame(datum_of(ground))
    data = await run_in_thread(write, rows, frame)
    headers = {**NO_STORE, "content-disposition": f'attachment; filename="{name}"'}
    return Response(data, media_type=media_type, headers=headers)


def _geojson(rows: list[Row], frame: MapFrame) -> bytes:
    """Encoded one by one: a single call would not let the loop run before its end."""
    features = b",".join(msgspec.json.encode(_feature(row, frame)) for row in rows)
    return b'{"type":"FeatureCollection","features":[' + features + b"]}"


def _csv(rows: list[Row], frame: MapFrame) -> bytes:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*WEED_COLUMNS, "lat_deg", "lon_deg"])
    for row in rows:
        lat_deg, lon_deg, _ = frame.geodetic_from_map(row[2], row[3])
        named = [row[0], CLASS_NAMES[row[1]], *row[2:]]
        writer.writerow([*named, round(lat_deg, 9), round(lon_deg, 9)])
    return buffer.getvalue().encode()


def _feature(row: Row, frame: MapFrame) -> dict[str, Any]:
    lat_deg, lon_deg, _ = frame.geodetic_from_map(row[2], row[3])
    named = dict(zip(WEED_COLUMNS, row, strict=True))
    named["class"] = CLASS_NAMES[row[1]]
    place = {"type": "Point", "coordinates": [round(lon_deg, 9), round(lat_deg, 9)]}
    return {"type": "Feature", "id": row[0], "geometry": place, "properties": named}


ROUTES = (
    ("GET", "/api/v1/session", session),
    ("GET", "/api/v1/field", field),
    ("GET", "/api/v1/robot", robot),
    ("GET", "/robot/{name:path}", robot_file),
    ("GET", "/api/v1/topics", topics),
    ("GET", "/api/v1/weeds.geojson", weeds_geojson),
    ("GET", "/api/v1/weeds.csv", weeds_csv),
)
