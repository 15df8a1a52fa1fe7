"""Recordings: list, download, mark, replay; and the settings of the run."""

from __future__ import annotations

import math
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from agribot.core.errors import ConfigError
from agribot.core.json_number import is_number
from agribot.ui.access import Caller
from agribot.ui.answers import (
    Unusable,
    inside,
    json_answer,
    json_body,
    name_of,
    need_operator,
    need_seat,
    served_file,
)
from agribot.ui.hub import Hub
from agribot.ui.off_the_loop import run_in_thread
from agribot.ui.replay import MAX_SPEED, MIN_SPEED, Replay
from agribot.ui.settings import live_value

RECORDING = "run.mcap"
MAX_LISTED = 500


async def recordings(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    folder = Path(hub.about.runs_dir)
    listed = await run_in_thread(_listed, folder)
    free = shutil.disk_usage(folder if folder.is_dir() else Path("/")).free
    current = hub.live.newest().get("recording", hub.about.current)
    shown = {"disk_free_bytes": free, "current": current or None, "recordings": listed}
    return json_answer(shown)


def _listed(folder: Path) -> list[dict[str, Any]]:
    runs = [path.parent for path in folder.glob(f"*/{RECORDING}")]
    newest_first = sorted(runs, key=lambda run: run.stat().st_mtime, reverse=True)
    return [_summary(run) for run in newest_first[:MAX_LISTED]]


def _summary(run: Path) -> dict[str, Any]:
    files = sorted(path.name for path in run.iterdir() if path.is_file())
    report = _report(run)
    written = datetime.fromtimestamp((run / RECORDING).stat().st_mtime, UTC)
    return {
        "name": run.name,
        "utc": written.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "size_bytes": sum((run / name).stat().st_size for name in files),
        "duration_s": (report.get("time") or {}).get("sim_s"),
        "profile": report.get("profile"),
        "ok": report.get("ok"),
        "reason": report.get("reason", "not finished"),
        "files": files,
    }


def _report(run: Path) -> dict[str, Any]:
    """Empty for a run that has none yet."""
    try:
        report = msgspec.json.decode((run / "report.json").read_bytes())
    except (OSError, msgspec.DecodeError):
        return {}
    return report if isinstance(report, dict) else {}


async def recording_file(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    run, file = request.path_params["run"], request.path_params["file"]
    folder = inside(Path(hub.about.runs_dir), run)
    if folder is None or "/" in run or not (folder / RECORDING).is_file():
        raise Unusable(404, f"no recording '{run[:80]}'")
    return served_file(folder, file, download=f"{run}-{file}")


async def mark(request: Request) -> Response:
    need_operator(request)
    hub: Hub = request.app.state.hub
    text = str((await json_body(request)).get("text", "")).strip()[:500]
    hub.event("mark", name_of(request), text)
    return Response(status_code=204)


async def start_recording(request: Request) -> Response:
    """The state tells in which folder."""
    return _record(request, "start_recording")


async def stop_recording(request: Request) -> Response:
    return _record(request, "stop_recording")


def _record(request: Request, action: str) -> Response:
    need_operator(request)
    hub: Hub = request.app.state.hub
    hub.event(action, name_of(request))
    return Response(status_code=204)


async def replay(request: Request) -> Response:
    """Show a recording to the caller's pages, or (name null) the robot again."""
    hub: Hub = request.app.state.hub
    wanted = await json_body(request)
    session = _session(request)
    name = wanted.get("name")
    hub.choices.pop(session, None)
    if name is None and not hub.about.recording:
        hub.end_replay(session)
        return json_answer(_shown(hub, session))
    speed, t_s = wanted.get("speed", 1.0), wanted.get("t_s")
    if not _is_between(speed, 0.0, MAX_SPEED):
        raise Unusable(400, f"speed {speed!r}: 0 (pause) or {MIN_SPEED:g} to {MAX_SPEED:g}")
    if t_s is not None and not _is_between(t_s, -1.0, math.inf):
        raise Unusable(400, f"t_s {t_s!r}: a time in seconds")
    player = hub.replay_of(session)
    if player is None or (name is not None and player.name != name):
        player = await _chosen(hub, session, str(name))
        if player is None:
            return json_answer(_shown(hub, session))
        hub.start_replay(session, player)
    player.speed = float(speed)
    if t_s is not None:
        player.seek(float(t_s))
    return json_answer(player.described())


def _shown(hub: Hub, session: str) -> dict[str, Any]:
    player = hub.replay_of(session)
    return {"source": hub.live.source} if player is None else player.described()


async def _chosen(hub: Hub, session: str, name: str) -> Replay | None:
    """A recording, or None where the browser asked for something else while it was read."""
    choice = hub.choices[session] = object()
    try:
        player = await run_in_thread(_opened, hub, name)
        return player if hub.choices.get(session) is choice else None
    finally:
        if hub.choices.get(session) is choice:
            del hub.choices[session]


def _opened(hub: Hub, name: str) -> Replay:
    folder = inside(Path(hub.about.runs_dir), name)
    path = None if folder is None or "/" in name else folder / RECORDING
    if path is None or not path.is_file():
        raise Unusable(404, f"no recording '{name[:80]}'")
    return Replay.load(path, name)


def _session(request: Request) -> str:
    caller: Caller = request.scope["agribot.caller"]
    if not caller.session:
        raise Unusable(409, "load the page first; a replay belongs to a page")
    return caller.session


def _is_between(value: object, low: float, high: float) -> bool:
    return is_number(value) and low <= value <= high


async def settings(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    return json_answer({"groups": hub.about.settings})


async def change_settings(request: Request) -> Response:
    """Each key is applied or refused for itself."""
    need_seat(request)
    hub: Hub = request.app.state.hub
    known = {key["key"]: key for group in hub.about.settings for key in group["keys"]}
    applied: dict[str, Any] = {}
    refused: dict[str, str] = {}
    for key, value in (await json_body(request)).items():
        if key not in known:
            refused[key] = "there is no such setting"
            continue
        try:
            number = live_value(hub.about.config, key, value)
        except ConfigError as error:
            refused[key] = str(error)
            continue
        hub.event("set", name_of(request), key, number)
        known[key]["value"] = applied[key] = value
    return json_answer({"applied": applied, "refused": refused})


ROUTES = (
    ("GET", "/api/v1/recordings", recordings),
    ("POST", "/api/v1/recordings/mark", mark),
    ("POST", "/api/v1/recordings/start", start_recording),
    ("POST", "/api/v1/recordings/stop", stop_recording),
    ("GET", "/api/v1/recordings/{run}/{file:path}", recording_file),
    ("POST", "/api/v1/replay", replay),
    ("GET", "/api/v1/settings", settings),
    ("PATCH", "/api/v1/settings", change_settings),
)
