"""What the operator's page costs: its server's CPU and memory, and the lateness of the robot.

One simulated robot drives at the pace of the clock while programs in another process look on as
browsers do: everybody reads the state, and each draws the camera; the last of many stalls.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from agribot.core import config
from agribot.core.errors import PlatformError
from agribot.ui.address import Address

if TYPE_CHECKING:
    from agribot.app.simulated_run import SimulatedRun
    from agribot.ui.robot_side.operator_page import OperatorPage

WARM_UP_S = 3.0
SETTLE_S = 20.0  # time until buffers have their size
SLOW_MPS = 0.15
GOOD_MBIT_PER_S, GOOD_AGE_S = 10.0, 0.25


class MemoryGrowth(msgspec.Struct, frozen=True, kw_only=True):
    """Memory while one client reads everything, and of a page in Chromium where there is one.

    `page_heap_growth_bytes` is what JavaScript holds after collecting its garbage.
    """

    seconds: float
    server_growth_bytes: int
    page_heap_growth_bytes: int | None


class LinkDelay(msgspec.Struct, frozen=True, kw_only=True):
    """Age of states and pictures on one page over a slow connection."""

    mbit_per_s: float
    state_hz: float
    state_age_p95_s: float
    camera_hz: float
    camera_age_p95_s: float


class Limit(msgspec.Struct, frozen=True, kw_only=True):
    """A figure and its limit; a figure that was not measured is not assessed."""

    name: str
    value: float | None
    low: float | None = None
    high: float | None = None

    @property
    def ok(self) -> bool:
        if self.value is None:
            return True
        return (self.low is None or self.value >= self.low) and (
            self.high is None or self.value <= self.high
        )


class Phase(msgspec.Struct, frozen=True, kw_only=True):
    """Figures for a number of clients. A tick is missed when it comes a whole period late."""

    clients: int
    stalled: int
    seconds: float
    server_cpu_ratio: float
    server_rss_bytes: int
    state_hz: float | None
    camera_hz: float | None
    ticks: int
    ticks_missed: int
    lateness_p99_s: float
    lateness_max_s: float


def measure_page(
    clients: Sequence[int] = (0, 1, 16),
    seconds: float = 20.0,
    camera: bool = True,
    profile: str = "farm",
    growth_s: float = 0.0,
    links_mbit_per_s: Sequence[float] = (),
) -> dict[str, Any]:
    """Measure each number of clients, then slow connections, then memory growth.

    The robot drives slowly, so that its mission outlasts the benchmark.
    Raises: AgribotError: the profile, the page's packages or a client do not work.
    """
    from agribot.app.simulated_run import simulate
    from agribot.ui.robot_side.operator_page import OperatorPage

    drive = f"mission.speed_mps={SLOW_MPS if growth_s else config.load(profile).mission.speed_mps}"
    chosen = [f"perception.enabled={str(camera).lower()}", "record.enabled=false", drive]
    settings = config.load(profile, chosen)
    with (
        tempfile.TemporaryDirectory() as folder,
        simulate(settings, Path(folder)) as session,
        OperatorPage(session, Address(port=0)) as page,
    ):
        clock = _Clock(session, 1.0 / settings.tick_hz)
        clock.drive(WARM_UP_S)
        phases = [_measure_phase(clock, page, count, seconds) for count in clients]
        links = [
            _measure_delay(clock, page, mbit_per_s, seconds) for mbit_per_s in links_mbit_per_s
        ]
        growth = _measure_growth(clock, page, growth_s) if growth_s else None
    limits = [*check_limits(phases, growth), *check_delays(links)]
    return {
        "benchmark": "ui",
        "camera": camera,
        "load_average": os.getloadavg()[0],
        "phases": [msgspec.to_builtins(phase) for phase in phases],
        "links": [msgspec.to_builtins(link) for link in links],
        "growth": msgspec.to_builtins(growth),
        "limits": [{**msgspec.to_builtins(limit), "ok": limit.ok} for limit in limits],
        "ok": all(limit.ok for limit in limits),
    }


def check_limits(phases: Sequence[Phase], growth: MemoryGrowth | None) -> list[Limit]:
    """Compare the page's CPU, memory and rate of messages with what they may be."""
    by_clients = {phase.clients: phase for phase in phases}
    one, many = by_clients.get(1), max(phases, key=lambda phase: phase.clients)
    limits = []
    if one is not None:
        limits.append(Limit(name="server CPU, 1 client", value=one.server_cpu_ratio, high=0.15))
        if many.clients > 1:
            more = round(many.server_cpu_ratio - one.server_cpu_ratio, 4)
            limits.append(Limit(name=f"more for {many.clients} clients", value=more, high=0.04))
    for phase in phases:
        if phase.state_hz is not None:
            name = f"states per second, {phase.clients} clients"
            limits.append(Limit(name=name, value=phase.state_hz, low=27.0, high=33.0))
    if growth is not None:
        page = growth.page_heap_growth_bytes
        limits.append(
            Limit(name="server growth, bytes", value=growth.server_growth_bytes, high=10e6)
        )
        limits.append(Limit(name="page growth, bytes", value=page, high=8e6))
    return limits


def check_delays(links: Sequence[LinkDelay]) -> list[Limit]:
    """Compare delays: a picture may be 0.25 s old by a good radio, twice that by a bad one."""
    return [
        Limit(
            name=f"age of pictures over {link.mbit_per_s:g} Mbit/s, p95, s",
            value=link.camera_age_p95_s,
            high=GOOD_AGE_S if link.mbit_per_s >= GOOD_MBIT_PER_S else 2.0 * GOOD_AGE_S,
        )
        for link in links
    ]


def _measure_delay(
    clock: _Clock, page: OperatorPage, mbit_per_s: float, seconds: float
) -> LinkDelay:
    words = [str(page.server.port), page.address.operator_token, str(mbit_per_s), str(seconds)]
    seen = _wait_for_result(_start("agribot.lab.bench.ui_link", words), clock)
    return LinkDelay(mbit_per_s=mbit_per_s, **seen)


def _measure_growth(clock: _Clock, page: OperatorPage, seconds: float) -> MemoryGrowth:
    pid = page.server.process.pid
    assert pid is not None  # it runs
    watching = _start_clients(page, 1, 0, seconds + SETTLE_S)
    browsing = _start_browser(page, seconds)
    clock.drive(SETTLE_S)
    before_bytes = _read_rss_bytes(pid)
    clock.drive(seconds)
    after_bytes = _read_rss_bytes(pid)
    _wait_for_result(watching, clock)
    try:
        heap = _wait_for_result(browsing, clock).get("heap_growth_bytes")
    except PlatformError:
        heap = None  # no browser here, as it printed itself
    return MemoryGrowth(
        seconds=seconds, server_growth_bytes=after_bytes - before_bytes, page_heap_growth_bytes=heap
    )


def _start_browser(page: OperatorPage, seconds: float) -> subprocess.Popen[str]:
    return _start("agribot.lab.bench.ui_browser", [page.url, str(seconds)])


def _start(module: str, words: Sequence[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", module, *words], stdout=subprocess.PIPE, text=True
    )


class _Clock:
    """A clock that drives the session in real time and notes how late each tick is."""

    def __init__(self, session: SimulatedRun, period_s: float) -> None:
        self._ticks: Iterator[Any] = session.ticks()
        self._period_s = period_s

    def drive(self, seconds: float) -> list[float]:
        """Return how late each tick is; one that is missed does not make the next ones late."""
        late_s: list[float] = []
        end_s = time.monotonic() + seconds
        due_s = time.monotonic()
        while due_s < end_s:
            if next(self._ticks, None) is None:
                raise PlatformError("the mission ended before the benchmark; measure for less time")
            due_s += self._period_s
            remaining_s = due_s - time.monotonic()
            late_s.append(max(-remaining_s, 0.0))
            if remaining_s > 0.0:
                time.sleep(remaining_s)
            else:
                due_s -= remaining_s
        return late_s

    @property
    def period_s(self) -> float:
        return self._period_s


def _measure_phase(clock: _Clock, page: OperatorPage, clients: int, seconds: float) -> Phase:
    stalled = 1 if clients > 1 else 0
    pid = page.server.process.pid
    assert pid is not None  # it runs
    watching = _start_clients(page, clients, stalled, seconds) if clients else None
    if watching is not None:
        clock.drive(2.0)  # until they are connected
    cpu_before_s, from_s = _read_cpu_s(pid), time.monotonic()
    late_s = sorted(clock.drive(seconds))
    passed_s, cpu_s = time.monotonic() - from_s, _read_cpu_s(pid) - cpu_before_s
    seen = _wait_for_result(watching, clock)
    return Phase(
        clients=clients,
        stalled=stalled,
        seconds=round(passed_s, 2),
        server_cpu_ratio=round(cpu_s / passed_s, 4),
        server_rss_bytes=_read_rss_bytes(pid),
        state_hz=seen.get("state_hz"),
        camera_hz=seen.get("camera_hz"),
        ticks=len(late_s),
        ticks_missed=sum(value > clock.period_s for value in late_s),
        lateness_p99_s=round(late_s[int(0.99 * (len(late_s) - 1))], 4),
        lateness_max_s=round(late_s[-1], 4),
    )


def _start_clients(
    page: OperatorPage, clients: int, stalled: int, seconds: float
) -> subprocess.Popen[str]:
    words = [str(page.server.port), page.address.operator_token, str(clients), str(stalled)]
    return _start("agribot.lab.bench.ui_clients", [*words, str(seconds)])


def _wait_for_result(watching: subprocess.Popen[str] | None, clock: _Clock) -> dict[str, Any]:
    """Keep the robot's pace until the clients have gone, and return their result."""
    if watching is None:
        return {}
    while watching.poll() is None:
        clock.drive(0.2)
    output, _ = watching.communicate()
    if watching.returncode:
        raise PlatformError(f"the clients ended with status {watching.returncode}; see above")
    result: dict[str, Any] = json.loads(output.splitlines()[-1])
    return result


def _read_cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _read_rss_bytes(pid: int) -> int:
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
