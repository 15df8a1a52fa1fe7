"""The drive of one cell: until the mission has ended, or the robot stands for a person for good."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.app.run_folder import clear_run
from agribot.app.workers import Stop
from agribot.core import config as settings
from agribot.core.errors import AgribotError
from agribot.core.messages import TickRecord
from agribot.lab.bench.fault_matrix.cells import PROFILE, Cell
from agribot.lab.bench.fault_matrix.states import ENDED, KILLED, SCRIPTS, TICK_HZ, Onsets, Person
from agribot.record.events import Event
from agribot.sim.safety_judge import Crush

if TYPE_CHECKING:
    from agribot.app.simulated_run import SimulatedRun

STANDING_MPS = 0.02
STANDS_S = 10.0  # a robot that stands for this time and waits for a person has ended
# Time for which a drive goes on after its mission, and where the fault begins after it.
AFTER_END_S, AFTER_LAST_S = 3.0, 20.0
KILLED_AT_S = 12.0  # time in simulation at which the program is killed
SETTLES_S = 1.0  # a robot that must stand has come to rest by then, without a fault
WAY_EVERY_S = 0.2


class CellTask(msgspec.Struct, frozen=True, kw_only=True):
    """A cell, the time of its fault on the clock of the job, its world, a folder for its files."""

    cell: Cell
    onset_s: float
    world: Path
    out_dir: Path


class CellResult(msgspec.Struct, frozen=True, kw_only=True):
    """What happened in the drive of a cell, without a verdict on it.

    `way` has pairs of time and metres driven, of the true clock and the true wheels. `rolled_m` is
    the longest way of a robot that had come to rest and had to stand.
    """

    cell: Cell
    onset_s: float = 0.0
    onsets_s: dict[str, float] = {}
    events: tuple[Event, ...] = ()
    crushes: tuple[Crush, ...] = ()
    stood_s: tuple[float, ...] = ()
    way: tuple[tuple[float, float], ...] = ()
    rolled_m: float = 0.0
    over_level_ratio: float | None = None
    outside_m: float = 0.0
    stop_m: float = 0.0
    stop_allowed_m: float | None = None
    stops_too_long: int = 0
    across_p95_m: float | None = None
    across_max_m: float | None = None
    plants: int = 0
    km: float = 0.0
    sim_s: float = 0.0
    cpu_s: float = 0.0
    reason: str = ""
    error: str = ""  # error that ended the program


def drive_cell(task: CellTask, stop: Stop) -> CellResult | None:
    """Drive a cell; None where it was stopped before its end."""
    try:
        clear_run(task.out_dir)
        session = _open(task)
    except AgribotError as error:
        return CellResult(cell=task.cell, onset_s=task.onset_s, error=str(error))
    with session:
        drive = _Drive(session, task)
        error_text = ""
        try:
            for record in _tick(session):
                if stop():
                    return None
                if drive.has_ended(record):
                    break
        except Exception as error:  # noqa: BLE001  what a fault may do to the program is a result
            error_text = f"{type(error).__name__}: {error}"
        result = drive.describe(error_text)
    clear_run(task.out_dir)
    return result


def _open(task: CellTask) -> SimulatedRun:
    from agribot.app.simulated_run import simulate

    cell = task.cell
    config = settings.load(PROFILE, [*cell.list_settings(task.onset_s), f"world={task.world}"])
    if cell.script != KILLED:
        return simulate(config, task.out_dir)
    return _open_again(config, task.out_dir)


def _open_again(config: settings.RunConfig, folder: Path) -> SimulatedRun:
    """Open a run that goes on with one whose program was killed."""
    from agribot.app.mission_file import continue_config, read_mission
    from agribot.app.simulated_run import simulate
    from agribot.app.whole_job import read_job

    first = folder / "killed"
    clear_run(first)
    with simulate(msgspec.structs.replace(config, faults=()), first) as session:
        for record in session.ticks():
            if record.batch.t_s >= KILLED_AT_S:
                break
    saved = read_mission(first)
    return simulate(continue_config(config, saved), folder, saved, read_job(first, saved))


def _tick(session: SimulatedRun) -> Iterator[TickRecord]:
    """Drive on, also after the end of the mission."""
    session.clock.start()
    limit_s = session.config.duration_s or math.inf
    while session.last is None or session.simulator.truth().t_s < limit_s:
        session.last = session.stack.tick(session.platform)
        yield session.last
    session.clock.stop()


class _Drive:
    """Watches one drive, and lets a person act in it."""

    def __init__(self, session: SimulatedRun, task: CellTask) -> None:
        self._session, self._task = session, task
        self._began_s = session.job.began_s
        self._person = Person(SCRIPTS[task.cell.script](session.inbox))
        self._onsets = Onsets(task.cell.script)
        self._stood_s = self._over_s = self._bound_s = self._rolled_m = self._longest_m = 0.0
        self._way_m = 0.0
        self._has_rested = False
        self._way: list[tuple[float, float]] = []
        is_last = task.cell.state == "end" or not task.cell.fault
        self._after_end_s = AFTER_LAST_S if is_last else AFTER_END_S

    def has_ended(self, record: TickRecord) -> bool:
        """Take in a tick; return whether nothing more is to be expected."""
        truth = self._session.simulator.truth()
        t_s = self._began_s + truth.t_s
        self._person(record)
        self._onsets(record, t_s)
        self._measure(record, t_s, truth.v_mps)
        is_on = t_s > self._task.onset_s
        status = record.status
        waits = bool(status.stopped or status.held) and self._person.is_done
        stands = is_on and waits and abs(truth.v_mps) < STANDING_MPS
        self._stood_s = self._stood_s + 1.0 / TICK_HZ if stands else 0.0
        self._over_s += (status.state in ENDED) / TICK_HZ
        return self._stood_s > STANDS_S or self._over_s > self._after_end_s

    def _measure(self, record: TickRecord, t_s: float, v_mps: float) -> None:
        self._way_m += abs(v_mps) / TICK_HZ
        if not self._way or t_s - self._way[-1][0] >= WAY_EVERY_S:
            self._way.append((round(t_s, 2), round(self._way_m, 3)))
        self._measure_roll(record, v_mps)

    def _measure_roll(self, record: TickRecord, v_mps: float) -> None:
        """Add up the way of a robot that has come to rest, and has to stand."""
        status = record.status
        must_stand = bool(status.stopped) or status.state != "running"
        if not must_stand or status.gate.state == "by hand":
            self._bound_s = self._rolled_m = 0.0
            self._has_rested = False
            return
        self._bound_s += 1.0 / TICK_HZ
        is_at_rest = abs(v_mps) < STANDING_MPS and self._bound_s > SETTLES_S
        self._has_rested = self._has_rested or is_at_rest
        if self._has_rested:
            self._rolled_m += abs(v_mps) / TICK_HZ
            self._longest_m = max(self._longest_m, self._rolled_m)

    def describe(self, error: str) -> CellResult:
        from agribot.app.report_card import report_card

        session = self._session
        session.stack.perception.settle()
        cell = self._task.cell
        report, score = report_card(session, error), session.referee.score_safety()
        return CellResult(
            cell=cell,
            onset_s=self._task.onset_s,
            onsets_s=self._onsets.found_s,
            events=tuple(
                msgspec.structs.replace(event, fact=None)
                for event in session.job.events(session.event_log.events)
            ),
            crushes=score.crushes,
            stood_s=score.stood_s,
            way=tuple(self._way),
            rolled_m=self._longest_m,
            over_level_ratio=score.over_level_ratio,
            outside_m=score.outside_m_max,
            stop_m=score.stop_distance_m_max,
            stop_allowed_m=score.stop_allowed_m,
            stops_too_long=score.stops_too_long,
            across_p95_m=report.tracking.xte_p95_m,
            across_max_m=report.tracking.xte_max_m,
            plants=report.tracking.plants_total or 0,
            km=(report.mission.distance_m or 0.0) / 1000.0,
            sim_s=report.time.sim_s or 0.0,
            cpu_s=report.time.cpu_s or 0.0,
            reason=report.reason,
            error=error,
        )
