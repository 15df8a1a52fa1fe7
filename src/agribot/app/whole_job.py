"""The whole of a job that several runs did, one after the other was cut off: one account of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Protocol

import msgspec

from agribot.app.beliefs import BeliefSums
from agribot.app.judge import Judge
from agribot.app.run_clock import Clock
from agribot.autonomy.perception_host import PerceptionMeter
from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.weeds.map import WeedMap
from agribot.autonomy.weeds.track import Track
from agribot.core.errors import RecordingError
from agribot.core.histogram import Histogram
from agribot.core.implement.kind import ReportLine
from agribot.core.messages import MappedPlant, TickRecord
from agribot.record.events import Event, read_whole_events
from agribot.record.mcap_file import find_damage
from agribot.record.replay import read_ticks, read_truth
from agribot.record.report import RunOfJob
from agribot.record.series import RunSeries, collect, join_series

FILE_NAME = "job.json"
RECORDING = "run.mcap"
LATENCY_BIN_S = 0.001


class JobSoFar(msgspec.Struct, frozen=True, kw_only=True):
    """Results of a job's runs until now; the last of `runs` wrote this.

    `lacks` says in words what of the earlier ones is lost. `latency_s` is what the network took for
    a picture, `used_s` the time from its capture to the tick that used it. Times of `plants` are
    those of the last run's clock.
    """

    runs: tuple[RunOfJob, ...]
    lacks: tuple[str, ...] = ()
    wall_s: float = 0.0
    cpu_s: float = 0.0
    frames: int = 0
    frames_cpu_s: float = 0.0
    latency_s: Histogram = msgspec.field(default_factory=lambda: Histogram(width=LATENCY_BIN_S))
    used_s: Histogram = msgspec.field(default_factory=lambda: Histogram(width=LATENCY_BIN_S))
    judged: dict[str, Any] | None = None
    plants: tuple[Track, ...] = ()
    implement: tuple[ReportLine, ...] = ()
    believed: BeliefSums = msgspec.field(default_factory=BeliefSums)
    format: int = 1

    @property
    def sim_s(self) -> float:
        return sum(run.run_s for run in self.runs)


NOTHING = JobSoFar(runs=())
# State of a mission that goes on without the account of the run before; see `read_job`.
UNKNOWN = JobSoFar(runs=(), lacks=("all but the mission itself: no account of them was given",))


class RunOfNow(Protocol):
    """Requests to the run that does the job now."""

    out_dir: Path
    clock: Clock
    judge: Judge | None

    @property
    def meter(self) -> PerceptionMeter | None: ...
    @property
    def weed_map(self) -> WeedMap: ...
    @property
    def implement_lines(self) -> tuple[ReportLine, ...]: ...


class WholeJob:
    """A tap: the time of this run counts with that of the earlier ones."""

    def __init__(self, run: RunOfNow, earlier: JobSoFar = NOTHING) -> None:
        """Let the judge and the weed map of the run continue from what `earlier` holds."""
        self._run, self._earlier = run, earlier
        counts = dict(earlier.latency_s.counts)
        self._latency_s, self._looked = Histogram(width=LATENCY_BIN_S, counts=counts), 0
        self._used_s = Histogram(width=LATENCY_BIN_S, counts=dict(earlier.used_s.counts))
        self._run_s = 0.0
        self.believed = msgspec.structs.replace(earlier.believed)
        self.lacks = list(earlier.lacks)
        if earlier.judged is not None:
            self.lacks += _restore_judgement(run.judge, earlier.judged)
        run.weed_map.restore(plants_before(earlier))
        self._events, lost_events = events_of(earlier.runs, run.out_dir)
        self.lacks += lost_events

    def __call__(self, record: TickRecord) -> None:
        self.believed.add(record, record.batch.t_s - self._run_s)
        self._run_s = record.batch.t_s
        if record.scenes:
            self._used_s.add([record.batch.t_s - scene.t_s for scene in record.scenes])

    @property
    def began_s(self) -> float:
        """Start of this run, on the clock of the whole job."""
        return self._earlier.sim_s

    @property
    def runs(self) -> tuple[RunOfJob, ...]:
        own = RunOfJob(folder=str(self._run.out_dir.resolve()), run_s=self._run_s)
        return (*self._earlier.runs, own)

    def snapshot(self) -> JobSoFar:
        earlier, meter, (wall_s, cpu_s) = self._earlier, self._run.meter, self._run.clock.spent
        if meter is not None:
            fresh = meter.latencies_s[self._looked :]
            self._looked += len(fresh)
            self._latency_s.add(fresh)
        return JobSoFar(
            runs=self.runs,
            lacks=tuple(self.lacks),
            wall_s=earlier.wall_s + wall_s,
            cpu_s=earlier.cpu_s + cpu_s,
            frames=earlier.frames + (meter.frames if meter else 0),
            frames_cpu_s=earlier.frames_cpu_s + (meter.cpu_s if meter else 0.0),
            latency_s=self._latency_s,
            used_s=self._used_s,
            judged=_export_judgement(self._run.judge),
            plants=self._run.weed_map.tracks,
            implement=add_lines(earlier.implement, self._run.implement_lines),
            believed=msgspec.structs.replace(self.believed),
        )

    def events(self, own: Iterable[Event]) -> tuple[Event, ...]:
        """Events of all runs, on the clock of the job."""
        return (*self._events, *events_later(own, self.began_s))

    def plants(self, own: Iterable[MappedPlant]) -> tuple[MappedPlant, ...]:
        return plants_later(own, self.began_s)

    def series(self, own: RunSeries) -> RunSeries:
        """Series of all runs whose recordings can be read; the others are noted in `lacks`."""
        series, lost = series_of(self._earlier.runs, own, self._run.out_dir)
        self.lacks += lost
        return series


def _export_judgement(judge: Judge | None) -> dict[str, Any] | None:
    """Write what a judge hands to the next run as values of JSON."""
    return None if judge is None else msgspec.to_builtins(judge.export_state())


def _restore_judgement(judge: Judge | None, judged: dict[str, Any]) -> list[str]:
    """Let the judge go on with an earlier judgement; what of it is lost, in words."""
    if judge is None:
        return ["what was measured before: no ground truth in this run"]
    from agribot.sim.scores import RefereeState

    try:
        lost = judge.restore(msgspec.convert(judged, RefereeState, str_keys=True))
    except msgspec.ValidationError as error:
        lost = f"what was measured before: broken: {error}"
    return [lost] if lost else []


def read_job(folder: Path, saved: SavedMission) -> JobSoFar:
    """Read the account of the runs up to that in `folder`; what cannot be read is lacking."""
    path = folder / FILE_NAME
    try:
        job = msgspec.json.decode(path.read_bytes(), type=JobSoFar)
    except OSError as error:
        why = error.strerror or str(error)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        why = f"broken: {error}"
    else:
        if job.runs and job.format == NOTHING.format:
            return job
        why = "it is of another version"
    return JobSoFar(
        runs=(RunOfJob(folder=str(folder.resolve()), run_s=saved.t_s),),
        lacks=(f"what was measured before ({path}: {why})",),
    )


def rows_only_believed(saved: SavedMission | None, earlier: JobSoFar) -> tuple[int, ...]:
    """Rows that a mission was saved with as done, where no referee's word on them is left."""
    if saved is None or saved.visit_name or earlier.judged is not None:
        return ()
    return tuple(row.index for row in saved.rows if row.done)


def add_lines(earlier: Sequence[ReportLine], own: Sequence[ReportLine]) -> tuple[ReportLine, ...]:
    """Add the figures of an implement up, name by name."""
    sums: dict[tuple[str, str], float] = {(line.name, line.unit): 0 for line in (*earlier, *own)}
    for line in (*earlier, *own):
        sums[line.name, line.unit] += line.value
    return tuple(ReportLine(name, value, unit) for (name, unit), value in sums.items())


def plants_before(earlier: JobSoFar) -> tuple[Track, ...]:
    """Return the weed map that a run takes over; on its clock all of it was seen before zero."""
    passed_s = earlier.runs[-1].run_s if earlier.runs else 0.0
    return tuple(track.earlier(passed_s) for track in earlier.plants)


def plants_later(plants: Iterable[MappedPlant], by_s: float) -> tuple[MappedPlant, ...]:
    """Shift the times of plants to a clock that began `by_s` earlier."""
    if not by_s:
        return tuple(plants)
    return tuple(
        msgspec.structs.replace(
            plant,
            first_seen_s=plant.first_seen_s + by_s,
            last_seen_s=plant.last_seen_s + by_s,
            treated_s=None if plant.treated_s is None else plant.treated_s + by_s,
        )
        for plant in plants
    )


def series_of(
    earlier: Sequence[RunOfJob], own: RunSeries, beside: Path
) -> tuple[RunSeries, list[str]]:
    """Join the series of earlier runs, from their recordings, and of this one; list lost ones."""
    parts, lost, began_s = [], [], 0.0
    for run in earlier:
        path = folder_of(run, beside) / RECORDING
        try:
            ticks = (tick for tick in read_ticks(path) if tick.batch.t_s <= run.run_s)
            truth = read_truth(path)
            parts.append((collect(ticks, truth[truth[:, 0] <= run.run_s]), began_s))
            gaps = (damage for damage in find_damage(path) if damage.is_gap)
            lost += [f"plots and table of rows: {gap.describe()}" for gap in gaps]
        except RecordingError as error:
            lost.append(f"plots and table of rows: {error}")
        began_s += run.run_s
    return join_series([*parts, (own, began_s)]), lost


def events_of(earlier: Sequence[RunOfJob], beside: Path) -> tuple[list[Event], list[str]]:
    """Collect the events of earlier runs on the clock of their job; list what is lost."""
    events: list[Event] = []
    lost: list[str] = []
    began_s = 0.0
    for run in earlier:
        try:
            own = read_whole_events(folder_of(run, beside) / "events.jsonl")
        except RecordingError as error:
            lost.append(f"events: {error}")
        else:
            events += events_later(own, began_s)
        began_s += run.run_s
    return events, lost


def folder_of(run: RunOfJob, beside: Path) -> Path:
    """Return its folder, or the one beside another run of the job if they were moved together."""
    folder = Path(run.folder)
    return folder if folder.exists() else beside.parent / folder.name


def events_later(events: Iterable[Event], by_s: float) -> tuple[Event, ...]:
    """Shift the times of events to a clock that began `by_s` earlier."""
    return tuple(msgspec.structs.replace(event, t_s=event.t_s + by_s) for event in events)
