"""How the robot is: checks with advice, rates against their nominal ones, a bundle for support."""

from __future__ import annotations

import io
import os
import platform
import shutil
import time
import zipfile
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from agribot.core.version import __version__
from agribot.ui.answers import json_answer, need_operator
from agribot.ui.hub import Hub
from agribot.ui.off_the_loop import run_in_thread

LOW_DISK_BYTES = 1_000_000_000
LATE_RATIO = 0.8  # of a nominal rate, below which a sensor is slow
SILENT_S = 1.0
SUPPORT_FILES = ("config.toml", "events.jsonl", "report.json")

Check = dict[str, Any]


async def health(request: Request) -> Response:
    return json_answer(_health(request.app.state.hub))


def _health(hub: Hub) -> dict[str, Any]:
    state = hub.live.newest()
    rates = measured_rates(hub)
    newest = hub.counts[-1] if hub.counts else {}
    return {
        "checks": [*_robot_checks(hub, state), *_rate_checks(rates), _disk(hub), _pages(hub)],
        "rates": rates,
        "cpu_ratio": cpu_ratio(hub),
        "memory_bytes": memory_bytes() + int(newest.get("memory_bytes", 0)),
        "server": {"cpu_s": time.process_time(), "memory_bytes": memory_bytes()},
        "log": list(hub.live.events)[-100:],
    }


def _check(name: str, state: str, text: str, advice: str = "", value: object = None) -> Check:
    return {"name": name, "state": state, "value": value, "text": text, "advice": advice}


def _robot_checks(hub: Hub, state: dict[str, Any]) -> list[Check]:
    if hub.is_robot_gone:
        return [_check("robot", "fault", "its program has ended", "start it again")]
    if not state:
        return [_check("robot", "warn", "no state yet", "wait for the first tick")]
    age_s = time.time() - state["wall_ms"] / 1e3
    checks = [
        _check("control loop", "fault", f"silent for {age_s:.1f} s", "look at its terminal", age_s)
        if age_s > SILENT_S
        else _check("control loop", "ok", "ticks arrive", value=round(age_s, 3))
    ]
    if state["stop"]:
        checks.append(_check("stop", "warn", state["stop"], "clear the stop to go on"))
    checks.append(_position(state))
    battery = state["battery"]
    if battery:
        low = battery["pct"] < 20.0
        text = f"{battery['v']:.1f} V, {battery['pct']:.0f} %"
        checks.append(_check("battery", "warn" if low else "ok", text, "charge it" if low else ""))
    return checks


def _position(state: dict[str, Any]) -> Check:
    std_m = state["std"][0]
    if state["pose"] is None:
        return _check("position", "warn", state["reason"] or "unknown", "wait for GNSS fixes")
    if std_m is not None and std_m > 0.1:
        advice = "open sky, or a receiver with corrections"
        return _check("position", "warn", f"known to {std_m:.2f} m only", advice, std_m)
    return _check("position", "ok", f"known to {std_m:.3f} m", value=std_m)


def _rate_checks(rates: list[dict[str, Any]]) -> list[Check]:
    checks = []
    for rate in rates:
        measured, expected = rate["measured_hz"], rate["expected_hz"]
        if measured is None or measured >= LATE_RATIO * expected:
            continue
        text = f"{measured:.1f} Hz instead of {expected:g} Hz"
        state = "fault" if measured == 0.0 else "warn"
        checks.append(_check(rate["topic"], state, text, "check its cable and power", measured))
    return checks


def measured_rates(hub: Hub) -> list[dict[str, Any]]:
    """Samples per second of the robot's own time, over the last few seconds."""
    first, last = (hub.counts[0], hub.counts[-1]) if len(hub.counts) > 1 else ({}, {})
    passed_s = last.get("t", 0.0) - first.get("t", 0.0)
    rates = []
    for topic, expected_hz in hub.about.rates.items():
        measured = None
        if passed_s > 0.0:
            count = last["topics"].get(topic, 0) - first["topics"].get(topic, 0)
            measured = round(count / passed_s, 2)
        rates.append({"topic": topic, "expected_hz": expected_hz, "measured_hz": measured})
    return rates


def cpu_ratio(hub: Hub) -> float | None:
    """Of one core, by the robot's program and this server together."""
    if len(hub.counts) < 2:
        return None
    first, last = hub.counts[0], hub.counts[-1]
    passed_s = float(last["wall_s"] - first["wall_s"])
    if passed_s <= 0.0:
        return None
    robot = float(last["cpu_s"] - first["cpu_s"]) / passed_s
    own = time.process_time() / (time.monotonic() - hub.started_s)
    return round(robot + own, 3)


def memory_bytes() -> int:
    """Resident memory of this process; 0 where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def _disk(hub: Hub) -> Check:
    folder = Path(hub.about.runs_dir)
    free = shutil.disk_usage(folder if folder.is_dir() else Path("/")).free
    text = f"{free / 1e9:.1f} GB free"
    if free < LOW_DISK_BYTES:
        return _check("disk", "warn", text, "delete old recordings", free)
    return _check("disk", "ok", text, value=free)


def _pages(hub: Hub) -> Check:
    dropped = sum(socket.client.dropped for socket in hub.sockets)
    text = f"{len(hub.sockets)} connected, {dropped} old states left out, {hub.refusals} refused"
    return _check("pages", "ok", text, value=len(hub.sockets))


async def support(request: Request) -> Response:
    """Settings, events, health and versions; no tokens, no pictures."""
    need_operator(request)
    data = await run_in_thread(_bundle, request.app.state.hub)
    headers = {"content-disposition": 'attachment; filename="agribot-support.zip"'}
    return Response(data, media_type="application/zip", headers=headers)


def _bundle(hub: Hub) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        versions = sorted(f"{d.metadata['Name']}=={d.version}" for d in distributions())
        machine = (
            f"agribot {__version__}\n{platform.platform()}\nPython {platform.python_version()}"
        )
        archive.writestr("versions.txt", "\n".join([machine, *versions]) + "\n")
        archive.writestr("health.json", msgspec.json.format(msgspec.json.encode(_health(hub))))
        archive.writestr("settings.json", msgspec.json.encode(hub.about.settings))
        archive.writestr("state.json", hub.live.state_text or "{}")
        run = Path(hub.about.runs_dir) / hub.about.current
        for name in SUPPORT_FILES:
            if hub.about.current and (run / name).is_file():
                archive.write(run / name, name)
    return buffer.getvalue()


ROUTES = (
    ("GET", "/api/v1/health", health),
    ("GET", "/api/v1/support.zip", support),
)
