"""Recordings: list, download, mark, replay; and the settings of the run."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from agribot.core.errors import ConfigError
from agribot.core.messages import ControlRecording, MarkMoment, RecordingAction
from agribot.ui import wire
from agribot.ui.server.access import Caller
from agribot.ui.server.answers import (
    Unusable,
    inside,
    json_answer,
    need_operator,
    need_seat,
    read_body,
    served_file,
    who_asks,
)
from agribot.ui.server.hub import Hub
from agribot.ui.server.off_the_loop import run_in_thread
from agribot.ui.server.replay import MAX_SPEED, MIN_SPEED, Replay
from agribot.ui.server.replays import NoRoom
from agribot.ui.settings import make_change

RECORDING = "run.mcap"
MAX_LISTED = 500
MAX_TEXT = 500


async def recordings(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    folder = Path(hub.about.runs_dir)
    listed = await run_in_thread(_list_runs, folder)
    free = shutil.disk_usage(folder if folder.is_dir() else Path("/")).free
    state = hub.live.state
    current = hub.about.current if state is None or state.recording is None else state.recording
    return json_answer(
        wire.Recordings(disk_free_bytes=free, current=current or None, recordings=listed)
    )


def _list_runs(folder: Path) -> list[wire.RecordingInfo]:
    runs = [path.parent for path in folder.glob(f"*/{RECORDING}")]
    newest_first = sorted(runs, key=lambda run: run.stat().st_mtime, reverse=True)
    return [_summarise(run) for run in newest_first[:MAX_LISTED]]


def _summarise(run: Path) -> wire.RecordingInfo:
    files = sorted(path.name for path in run.iterdir() if path.is_file())
    report = _report(run)
    written = datetime.fromtimestamp((run / RECORDING).stat().st_mtime, UTC)
    return wire.RecordingInfo(
        name=run.name,
        utc=written.strftime("%Y-%m-%dT%H:%M:%SZ"),
        size_bytes=sum((run / name).stat().st_size for name in files),
        duration_s=(report.get("time") or {}).get("sim_s"),
        profile=report.get("profile"),
        ok=report.get("ok"),
        reason=report.get("reason", "not finished"),
        files=files,
    )


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
        raise Unusable(404, f"no recording '{run[:80]}'; load the page again")
    return served_file(folder, file, download=f"{run}-{file}")


async def mark(request: Request) -> Response:
    need_operator(request)
    hub: Hub = request.app.state.hub
    text = (await read_body(request, wire.MarkText)).text
    hub.send(MarkMoment(text=text.strip()[:MAX_TEXT]), who_asks(request))
    return Response(status_code=204)


async def start_recording(request: Request) -> Response:
    """Begin a recording; the state names its folder."""
    return _record(request, "start")


async def stop_recording(request: Request) -> Response:
    return _record(request, "stop")


def _record(request: Request, action: RecordingAction) -> Response:
    need_operator(request)
    hub: Hub = request.app.state.hub
    hub.send(ControlRecording(action=action), who_asks(request))
    return Response(status_code=204)


async def replay(request: Request) -> Response:
    """Show a recording to the caller's pages, or (name null) the robot again."""
    hub: Hub = request.app.state.hub
    wanted = await read_body(request, wire.ReplayWish)
    session = _session(request)
    hub.choices.pop(session, None)
    if wanted.name is None and not hub.about.recording:
        hub.end_replay(session)
        return json_answer(_describe_shown(hub, session))
    if not 0.0 <= wanted.speed <= MAX_SPEED:
        raise Unusable(400, f"speed {wanted.speed!r}; send 0 or {MIN_SPEED:g} to {MAX_SPEED:g}")
    if wanted.t_s is not None and wanted.t_s < -1.0:
        raise Unusable(400, f"t_s {wanted.t_s!r}; send a time in seconds")
    player = hub.replays.find(session)
    if player is None or (wanted.name is not None and player.name != wanted.name):
        player = await _choose(hub, request.scope["agribot.caller"], str(wanted.name))
        if player is None:
            return json_answer(_describe_shown(hub, session))
    player.speed = wanted.speed
    if wanted.t_s is not None:
        player.seek(wanted.t_s)
    return json_answer(_describe_shown(hub, session))


def _describe_shown(hub: Hub, session: str) -> wire.Shown:
    player = hub.replays.find(session)
    if player is None:
        return wire.Shown(source=hub.live.source)
    return wire.Shown(source="replay", replay=player.progress)


async def _choose(hub: Hub, caller: Caller, name: str) -> Replay | None:
    """Show a recording; None where the browser asked for something else while it was read."""
    session = caller.session
    choice = hub.choices[session] = object()
    try:
        hub.replays.find_victim(session, caller.role)  # before the work of reading it
        player = await run_in_thread(_open, hub, name)
        if hub.choices.get(session) is not choice:
            return None
        hub.start_replay(session, player, caller.role)
        return player
    except NoRoom as full:
        raise Unusable(503, str(full)) from full
    finally:
        if hub.choices.get(session) is choice:
            del hub.choices[session]


def _open(hub: Hub, name: str) -> Replay:
    folder = inside(Path(hub.about.runs_dir), name)
    path = None if folder is None or "/" in name else folder / RECORDING
    if path is None or not path.is_file():
        raise Unusable(404, f"no recording '{name[:80]}'; load the page again")
    return Replay.load(path, name)


def _session(request: Request) -> str:
    caller: Caller = request.scope["agribot.caller"]
    if not caller.session:
        raise Unusable(409, "load the page first; a replay belongs to a page")
    return caller.session


async def settings(request: Request) -> Response:
    hub: Hub = request.app.state.hub
    return json_answer(wire.SettingGroups(groups=hub.about.settings))


async def change_settings(request: Request) -> Response:
    """Each key is applied or refused for itself."""
    need_seat(request)
    hub: Hub = request.app.state.hub
    known = {setting.key: setting for group in hub.about.settings for setting in group.keys}
    applied: dict[str, Any] = {}
    refused: dict[str, str] = {}
    for key, value in (await read_body(request, dict[str, Any])).items():
        if key not in known:
            refused[key] = "there is no such setting"
            continue
        try:
            change = make_change(hub.about.config, key, value)
        except ConfigError as error:
            refused[key] = str(error)
            continue
        hub.send(change, who_asks(request))
        known[key].value = applied[key] = value
    return json_answer(wire.SettingsReply(applied=applied, refused=refused))


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
