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
from typing import NamedTuple

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from agribot.core.fact_text import render_apart
from agribot.core.facts import (
    BatteryHolds,
    DiskFree,
    Fact,
    NoTickYet,
    PagesConnected,
    PositionKnown,
    PositionUnknown,
    ProgramEnded,
    ProgramSilent,
    RateLow,
    Said,
    StopToClear,
    TicksArrive,
)
from agribot.core.version import __version__
from agribot.ui import wire
from agribot.ui.server.answers import json_answer, need_operator
from agribot.ui.server.hub import Hub
from agribot.ui.server.languages import language_of
from agribot.ui.server.off_the_loop import run_in_thread

LOW_DISK_BYTES = 1_000_000_000
LATE_RATIO = 0.8  # share of a nominal rate, below which a sensor is slow
SILENT_S = 1.0
LOW_CHARGE_PCT = 20.0
LOW_ACCURACY_M = 0.1  # one sigma
SUPPORT_FILES = ("config.toml", "events.jsonl", "report.json")


async def health(request: Request) -> Response:
    return json_answer(_health(request.app.state.hub, language_of(request)))


def _health(hub: Hub, language: str = "en") -> wire.Health:
    rates = measure_rates(hub)
    memory = memory_bytes()
    found = [*_robot_checks(hub), *_rate_checks(rates), _disk(hub), _pages(hub)]
    return wire.Health(
        checks=[_show(check, language) for check in found],
        rates=rates,
        cpu_ratio=cpu_ratio(hub),
        memory_bytes=memory,
        server=wire.ServerCost(cpu_s=time.process_time(), memory_bytes=memory),
        log=list(hub.live.events)[-100:],
    )


class _Found(NamedTuple):
    """A check by its name, what it found, and its number."""

    name: str
    state: wire.CheckState
    fact: Fact
    value: float | None = None


def _show(found: _Found, language: str) -> wire.HealthCheck:
    text, advice = render_apart(found.fact, language)
    return wire.HealthCheck(
        name=found.name, state=found.state, text=text, advice=advice, value=found.value
    )


def _robot_checks(hub: Hub) -> list[_Found]:
    state = hub.live.state
    if hub.is_robot_gone:
        return [_Found("robot", "fault", ProgramEnded())]
    if state is None:
        return [_Found("robot", "warn", NoTickYet())]
    age_s = time.monotonic() - state.mono_ms / 1e3
    checks = [
        _Found("control loop", "fault", ProgramSilent(age_s), age_s)
        if age_s > SILENT_S
        else _Found("control loop", "ok", TicksArrive(), round(age_s, 3))
    ]
    if state.stop:
        checks.append(_Found("stop", "warn", StopToClear(state.stop_fact or Said(state.stop))))
    battery = [_battery(state.battery)] if state.battery else []
    return [*checks, _position(state), *battery]


def _battery(battery: wire.BatteryState) -> _Found:
    charge = battery.charge_pct
    is_low = charge is not None and charge < LOW_CHARGE_PCT
    fact = BatteryHolds(battery.voltage_v, charge, is_low)
    return _Found("battery", "warn" if is_low else "ok", fact)


def _position(state: wire.State) -> _Found:
    std_m = state.pos_std_m
    if state.pose is None or std_m is None:
        why = state.reason_fact or (Said(state.reason) if state.reason else None)
        return _Found("position", "warn", PositionUnknown(why))
    is_poor = std_m > LOW_ACCURACY_M
    return _Found("position", "warn" if is_poor else "ok", PositionKnown(std_m, is_poor), std_m)


def _rate_checks(rates: list[wire.SensorRate]) -> list[_Found]:
    checks = []
    for rate in rates:
        measured_hz, expected_hz = rate.measured_hz, rate.expected_hz
        if measured_hz is None or expected_hz is None or measured_hz >= LATE_RATIO * expected_hz:
            continue
        state: wire.CheckState = "fault" if measured_hz == 0.0 else "warn"
        checks.append(_Found(rate.topic, state, RateLow(measured_hz, expected_hz), measured_hz))
    return checks


def measure_rates(hub: Hub) -> list[wire.SensorRate]:
    """Count samples per second of the robot's own time, over the last few seconds."""
    counts = hub.counts
    passed_s = counts[-1].t_s - counts[0].t_s if counts else 0.0
    rates = []
    for topic, expected_hz in hub.about.rates.items():
        measured_hz = None
        if passed_s > 0.0:
            count = counts[-1].samples.get(topic, 0) - counts[0].samples.get(topic, 0)
            measured_hz = round(count / passed_s, 2)
        rates.append(wire.SensorRate(topic=topic, expected_hz=expected_hz, measured_hz=measured_hz))
    return rates


def cpu_ratio(hub: Hub) -> float | None:
    """Load of one core by the robot's program and this server together."""
    counts = hub.counts
    passed_s = counts[-1].wall_s - counts[0].wall_s if counts else 0.0
    if passed_s <= 0.0:
        return None
    robot = (counts[-1].cpu_s - counts[0].cpu_s) / passed_s
    own = time.process_time() / (time.monotonic() - hub.started_s)
    return round(robot + own, 3)


def memory_bytes() -> int:
    """Resident memory of this process; 0 where the system does not report it."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def _disk(hub: Hub) -> _Found:
    folder = Path(hub.about.runs_dir)
    free = shutil.disk_usage(folder if folder.is_dir() else Path("/")).free
    is_low = free < LOW_DISK_BYTES
    return _Found("disk", "warn" if is_low else "ok", DiskFree(free / 1e9, is_low), free)


def _pages(hub: Hub) -> _Found:
    dropped = sum(socket.client.dropped for socket in hub.sockets)
    fact = PagesConnected(len(hub.sockets), dropped, hub.refusals)
    return _Found("pages", "ok", fact, len(hub.sockets))


async def support(request: Request) -> Response:
    """Pack settings, events, health and versions; no tokens, no pictures."""
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
        archive.writestr("state.json", hub.live.write_state() or "{}")
        run = Path(hub.about.runs_dir) / hub.about.current
        for name in SUPPORT_FILES:
            if hub.about.current and (run / name).is_file():
                archive.write(run / name, name)
    return buffer.getvalue()


ROUTES = (
    ("GET", "/api/v1/health", health),
    ("GET", "/api/v1/support.zip", support),
)
