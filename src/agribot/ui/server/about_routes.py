"""What does not change while the robot runs: session, field, robot; and the weed map's files."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path

import msgspec
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from agribot.core.geo import Datum
from agribot.core.version import __version__
from agribot.record.weeds import WEED_COLUMNS, weed_features
from agribot.ui import wire
from agribot.ui.server.access import Caller
from agribot.ui.server.answers import NO_STORE, channel_of, json_answer, refuse_request
from agribot.ui.server.field_check import datum_of
from agribot.ui.server.hub import Hub
from agribot.ui.server.off_the_loop import run_in_thread
from agribot.ui.server.replay import Replay


async def session(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    caller: Caller = request.scope["agribot.caller"]
    if caller.role is None:
        return json_answer(wire.LoginNeeded(version=__version__))
    about = hub.about
    shows_address = about.lan_url and caller.role == "operator"
    return json_answer(
        wire.SessionInfo(
            version=__version__,
            run=about.run_id,
            profile=about.profile,
            source=hub.live.source,
            role=caller.role,
            lan_url=about.lan_url or None,
            qr_svg=qr_svg(about.lan_url) if shows_address else None,
            camera=about.robot.camera is not None,
        )
    )


def qr_svg(url: str) -> str:
    """Draw an address as a QR code, for the camera of a tablet."""
    import segno

    buffer = io.BytesIO()
    segno.make(url, error="m").save(buffer, kind="svg", scale=6, xmldecl=False)
    return buffer.getvalue().decode()


async def field(request: Request) -> Response:
    """Return the field of the robot, or of the recording of this name that the caller is shown."""
    hub: Hub = request.app.state.hub
    name = request.query_params.get("recording")
    if name is None:
        return json_answer(hub.about.field)
    shown = channel_of(request)
    if not isinstance(shown, Replay) or shown.name != name:
        return refuse_request(404, f"no recording '{name[:80]}' is shown here")
    return json_answer(shown.field)


async def robot(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    return json_answer(hub.about.robot)


async def robot_file(request: Request) -> Response:
    """Serve the description and the meshes that it names, and no other file."""
    hub: Hub = request.app.state.hub
    name = request.path_params["name"]
    if name == "robot.urdf":
        return Response(hub.about.urdf, media_type="application/xml")
    path = hub.about.meshes.get(name)
    if path is None or not Path(path).is_file():
        return refuse_request(404, f"the robot has no file '{name[:80]}'")
    headers = {"cache-control": "max-age=3600"}
    return FileResponse(path, media_type="model/stl", headers=headers)


async def topics(request: Request) -> Response:
    signals = wire.SIGNALS
    return json_answer([wire.SignalInfo(name=n, unit=unit, fields=[n]) for n, unit in signals])


async def weeds_geojson(request: Request) -> Response:
    return await _weed_file(request, _geojson, "weeds.geojson", "application/geo+json")


async def weeds_csv(request: Request) -> Response:
    return await _weed_file(request, _csv, "weeds.csv", "text/csv")


async def _weed_file(
    request: Request, write: Callable[[list[wire.Weed], Datum], bytes], name: str, media_type: str
) -> Response:
    hub: Hub = request.app.state.hub
    shown = channel_of(request)
    ground = shown.field if isinstance(shown, Replay) else hub.about.field
    weeds, datum = list(shown.weeds.values()), datum_of(ground)
    data = await run_in_thread(write, weeds, datum)
    headers = {**NO_STORE, "content-disposition": f'attachment; filename="{name}"'}
    return Response(data, media_type=media_type, headers=headers)


def _geojson(weeds: list[wire.Weed], datum: Datum) -> bytes:
    """Encode plants one by one: a single call would not let the loop run before its end."""
    features = b",".join(map(msgspec.json.encode, weed_features(weeds, datum)))
    return b'{"type":"FeatureCollection","features":[' + features + b"]}"


def _csv(weeds: list[wire.Weed], datum: Datum) -> bytes:
    """Write a row for each plant, with the features' properties and their place as columns."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*WEED_COLUMNS, "lat_deg", "lon_deg"])
    for feature in weed_features(weeds, datum):
        lon_deg, lat_deg = feature["geometry"]["coordinates"]
        values = [feature["properties"][column] for column in WEED_COLUMNS]
        writer.writerow([*values, lat_deg, lon_deg])
    return buffer.getvalue().encode()


ROUTES = (
    ("GET", "/api/v1/session", session),
    ("GET", "/api/v1/field", field),
    ("GET", "/api/v1/robot", robot),
    ("GET", "/robot/{name:path}", robot_file),
    ("GET", "/api/v1/topics", topics),
    ("GET", "/api/v1/weeds.geojson", weeds_geojson),
    ("GET", "/api/v1/weeds.csv", weeds_csv),
)
