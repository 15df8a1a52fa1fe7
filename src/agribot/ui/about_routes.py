"""What does not change while the robot runs: session, field, robot; and the weed map's files."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from agribot import __version__
from agribot.geo import Datum, MapFrame
from agribot.ui.access import Caller
from agribot.ui.answers import channel_of, json_answer, refused
from agribot.ui.channel import signal_table
from agribot.ui.hub import Hub

SCREENS = (
    "drive", "teleop", "camera", "weeds", "plan", "plots", "robot", "recordings", "settings",
    "health",
)  # fmt: skip
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
    hub: Hub = request.app.state.hub
    return json_answer(hub.about.field)


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
    return Response(Path(path).read_bytes(), media_type="model/stl", headers=headers)


async def topics(request: Request) -> Response:
    table = signal_table()
    pairs = zip(table["names"], table["units"], strict=True)
    return json_answer([{"name": name, "unit": unit, "fields": [name]} for name, unit in pairs])


async def weeds_geojson(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    frame = _frame(hub)
    features = [_feature(row, frame) for row in channel_of(request).weeds.values()]
    headers = {"content-disposition": 'attachment; filename="weeds.geojson"'}
    answer = json_answer({"type": "FeatureCollection", "features": features})
    answer.headers.update(headers)
    answer.headers["content-type"] = "application/geo+json"
    return answer


async def weeds_csv(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    frame = _frame(hub)
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*WEED_COLUMNS, "lat_deg", "lon_deg"])
    for row in channel_of(request).weeds.values():
        lat_deg, lon_deg, _ = frame.geodetic_from_map(row[2], row[3])
        named = [row[0], CLASS_NAMES[row[1]], *row[2:]]
        writer.writerow([*named, round(lat_deg, 9), round(lon_deg, 9)])
    headers = {"content-disposition": 'attachment; filename="weeds.csv"'}
    return Response(buffer.getvalue(), media_type="text/csv", headers=headers)


def _frame(hub: Hub) -> MapFrame:
    datum = hub.about.field["datum"]
    return MapFrame(Datum(lat_deg=datum["lat_deg"], lon_deg=datum["lon_deg"]))


def _feature(row: list[Any], frame: MapFrame) -> dict[str, Any]:
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
