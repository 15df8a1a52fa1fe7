"""The campaign of faults: what the robot notices, what it does about it, and what it costs.

Every scenario is a drive into a row in which one thing goes wrong; it ends some time after that,
or when the robot stands for good. Beside them the same drives without any fault are judged: what
stops the robot there is a false alarm.
"""

from __future__ import annotations

import re
import statistics
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

from agribot.app.run_folder import clear_run
from agribot.app.workers import Stop, results
from agribot.core.errors import AgribotError, ConfigError
from agribot.lab.sweep.execution import Assignment, RunOutcome
from agribot.lab.sweep.plan import SweepJob, read_seeds
from agribot.record.report import FaultReport, Report
from agribot.sim.faults.schedule import parse_fault, read_faults
from agribot.sim.faults.table import FAULTS

PRESET = "field"  # how the world differs from its map and from seed to seed
AFTER_S = 45.0
STANDS_S = 5.0  # a robot that stands for so long, and waits for a person, has come to its end
STANDING_MPS = 0.02
IN_ROW_S = {"rows-10x12": 20.0, "farm": 32.0, "hills": 32.0, "beet": 20.0}
DEFAULT_SEEDS = "1-5"
# What happens to the motor board, to what is wired to it and to its line.
BELOW_THE_STACK = ("imu", "mag", "wheels", "motor", "bumper", "button", "battery", "board", "link")
PLATFORMS = ("sim", "firmware")
ENDED = "ended by an error: "
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")


class FaultScenario(NamedTuple):
    """A fault without its time, empty for none, and the drive in which it happens.

    `is_detectable` is false where nothing on board could tell the fault from what is usual.
    """

    fault: str
    profile: str = "rows-10x12"
    sensors: str = "rtk"
    has_camera: bool = False
    lasts_s: float | None = None
    is_detectable: bool = True
    also: str = ""  # a second fault in the same moment
    platform: str = "sim"  # or `firmware`, the simulator on the motor board's real program

    @property
    def faults(self) -> tuple[str, ...]:
        return tuple(filter(None, (self.fault, self.also)))

    @property
    def name(self) -> str:
        """Name the scenario in tables; every one is another."""
        lasting = f"+{self.lasts_s:g}" if self.lasts_s else ""
        return f"{' and '.join(self.faults)}{lasting}" if self.fault else "no fault"

    @property
    def drive(self) -> str:
        return _name_drive(self)

    def list_settings(self) -> tuple[str, ...]:
        """List the settings that make this drive."""
        in_row_s = IN_ROW_S[self.profile]
        lasting = f"+{self.lasts_s:g}" if self.lasts_s else ""
        kinds = [parse_fault(f"{fault}@0").kind for fault in self.faults]
        begin_s = [0.0 if kind.at_start else in_row_s for kind in kinds]
        pairs = zip(self.faults, begin_s, strict=True)
        texts = ", ".join(f'"{fault}@{t_s:g}{lasting}"' for fault, t_s in pairs)
        is_recorded = any(kind.part == "disk" for kind in kinds)
        return (
            f"sim.preset={PRESET}",
            f"sim.sensors={self.sensors}",
            f"perception.enabled={str(self.has_camera).lower()}",
            f"record.enabled={str(is_recorded).lower()}",
            f"duration_s={in_row_s + AFTER_S:g}",
            f"faults=[{texts}]",
            f"platform={self.platform}",
        )


def _name_drive(of: FaultScenario | FaultRow) -> str:
    camera = " camera" if of.has_camera else ""
    platform = "" if of.platform == "sim" else f" {of.platform}"
    return f"{of.profile} {of.sensors}{camera}{platform}"


def _all(faults: str, **drive: Any) -> tuple[FaultScenario, ...]:
    return tuple(FaultScenario(fault, **drive) for fault in faults.split())


SCENARIOS = (
    *_all("gnss.outage gnss.jump=0.1 gnss.jump=0.5 gnss.jump=2 gnss.jump=100"),
    FaultScenario("gnss.outage", lasts_s=8.0),
    *_all("gnss.wrong_fix=0.2 gnss.wrong_fix=0.4 gnss.wrong_fix=1 gnss.wrong_fix=2"),
    FaultScenario("gnss.drift=0.01", is_detectable=False),
    *_all("gnss.drift=0.05 gnss.drift=0.5 gnss.frozen gnss.velocity=10 gnss.velocity=100"),
    *_all("gnss.outage gnss.wrong_fix=0.5 gnss.frozen", sensors="rtk-dual"),
    *_all("mag.motor mag.offset=5 mag.offset=30"),
    *_all("imu.bias=0.01 imu.bias=0.05 imu.bias=0.3 imu.frozen"),
    *_all("imu.late=0.1 imu.late=0.25 imu.late=1"),
    *_all("wheels.stuck=right_wheel_R wheels.stuck=left_wheel_F wheels.reversed"),
    *_all("motor.dead=right_wheel_R motor.dead=left_wheel_F motor.weak=0.005"),
    FaultScenario("motor.weak=0.05", is_detectable=False),  # it is never asked for more in a row
    *_all("motor.runaway soil.mud=0.1 soil.mud=0.03"),
    *_all("bumper.contact obstacle.unmapped battery.empty"),
    *_all("button.pressed imu.unplugged board.hung"),
    *_all("clock.step=0.2 clock.step=2 clock.step=-2 link.noise=0.01 link.noise=0.2"),
    *_all("board.silent disk.full start.aside=0.3 start.aside=1 start.turned=20"),
    *_all("start.turned=30 start.turned=90 carried=0.3 carried=1"),
    FaultScenario("gnss.drift=0.05", also="imu.bias=0.05"),
    FaultScenario("gnss.frozen", also="mag.offset=30"),
    FaultScenario("gnss.wrong_fix=0.4", also="imu.bias=0.05"),
    FaultScenario("gnss.outage", also="mag.offset=30"),
    *_all("gnss.outage gnss.drift=0.05 obstacle.unmapped carried=0.3", profile="farm"),
    *_all("motor.dead=left_wheel_F soil.mud=0.1 imu.bias=0.05", profile="hills"),
    *_all("camera.black camera.frozen camera.flipped camera.late=0.5 camera.late=2 camera.off "
          "network.hung gnss.outage gnss.wrong_fix=2 gnss.frozen mag.offset=30", sensors="m8n",
          has_camera=True),
    *_all("start.aside=1", sensors="m8n", has_camera=True),
    FaultScenario("camera.frozen", sensors="m8n", has_camera=True, also="gnss.wrong_fix=2"),
    *_all("gnss.wrong_fix=0.4 gnss.drift=0.01 camera.flipped obstacle.unmapped", has_camera=True),
    FaultScenario("camera.frozen", has_camera=True, also="gnss.wrong_fix=0.4"),
)  # fmt: skip


class FaultRow(msgspec.Struct, frozen=True, kw_only=True):
    """One scenario over its seeds; what was never measured is None.

    `reaction` and `reason` are the most frequent ones; `ended_badly` counts the runs that a
    program error, an overturned robot or a diverging simulation ended.
    """

    fault: str
    profile: str
    sensors: str
    has_camera: bool
    is_detectable: bool
    runs: int
    detected_ratio: float | None = None
    time_to_detect_s: float | None = None
    reaction: str = ""
    named_ratio: float | None = None
    crushed_after: int | None = None
    plants: int = 0
    outside_m_max: float | None = None
    stop_distance_m_max: float | None = None
    reason: str = ""
    ended_badly: int = 0
    why_ended: str = ""
    platform: str = "sim"


def choose_scenarios(
    faults: Sequence[str], has_camera: bool | None, platform: str = "sim"
) -> tuple[FaultScenario, ...]:
    """Choose the scenarios of these faults, and the drives without a fault beside them.

    `has_camera` None takes both kinds.

    Raises: ConfigError: none is left.
    """
    chosen = [
        scenario._replace(platform=platform)
        for scenario in SCENARIOS
        if any(parse_fault(f"{fault}@0").name in faults for fault in scenario.faults)
        and has_camera in (None, scenario.has_camera)
    ]
    if not chosen:
        kind = "with a camera" if has_camera else "without a camera"
        raise ConfigError(f"no scenario {kind} has one of these faults: {', '.join(faults)}")
    drives = dict.fromkeys(_leave_out_fault(scenario) for scenario in chosen)
    return (*drives, *chosen)


def _leave_out_fault(scenario: FaultScenario) -> FaultScenario:
    return scenario._replace(fault="", also="", lasts_s=None, is_detectable=True)


def list_fault_names(platform: str = "sim") -> tuple[str, ...]:
    """List the faults of a platform; real firmware is tried by those at the board and below it."""
    names = (kind.name for kind in FAULTS)
    return tuple(n for n in names if platform == "sim" or n.split(".")[0] in BELOW_THE_STACK)


def list_jobs(scenarios: Sequence[FaultScenario], seeds: str) -> tuple[SweepJob, ...]:
    """List all runs, the first seed of every scenario before the second.

    Raises: ConfigError: a seed is none, or a scenario does not fit the program.
    """
    jobs = []
    for seed in read_seeds(seeds):
        for number, scenario in enumerate(scenarios):
            name = re.sub(r"[^A-Za-z0-9.+-]+", "_", f"{scenario.drive}-{scenario.name}")
            job = SweepJob(
                name=f"{seed}-{number:02d}-{name}", profile=scenario.profile, seed=seed,
                fixed=(), settings=scenario.list_settings(),
            )  # fmt: skip
            read_faults(job.config())
            jobs.append(job)
    return tuple(jobs)


class FaultExecutor:
    """`workers` processes; a run that ends in an error has a report, too."""

    def __init__(self, workers: int) -> None:
        self._workers = workers

    def run(self, assignments: Sequence[Assignment], stop: Stop) -> Iterator[RunOutcome]:
        done = results(drive_scenario, assignments, self._workers, stop)
        return (outcome for outcome in done if outcome is not None)


def drive_scenario(assignment: Assignment, stop: Stop) -> RunOutcome | None:
    """Drive until the robot's end or that of the time; None where it was stopped before.

    Raises: AgribotError: it could not even begin.
    """
    from agribot.app.report_card import report_card
    from agribot.app.simulated_run import simulate

    job, why = assignment.job, ""
    try:
        clear_run(assignment.out_dir)
        session = simulate(job.config(), assignment.out_dir)
    except AgribotError as error:
        return RunOutcome(job=job, error=str(error))
    with session:
        stood = 0.0
        try:
            for record in session.ticks():
                if stop():
                    return None
                status = record.status
                waits = bool(status.stopped or status.held) or status.state == "failed"
                stands = abs(session.simulator.truth().v_mps) < STANDING_MPS
                stood = stood + 1.0 / session.config.tick_hz if waits and stands else 0.0
                if stood > STANDS_S:
                    break
        except Exception as error:  # noqa: BLE001  what a fault may do to the program is a result
            is_told = isinstance(error, AgribotError)
            why = str(error) if is_told else f"program error: {type(error).__name__}: {error}"
            session.clock.stop()
        session.stack.perception.settle()
        report = report_card(session, f"{ENDED}{why}" if why else "")
    clear_run(assignment.out_dir)
    return RunOutcome(job=job, report=report)


def make_rows(
    scenarios: Sequence[FaultScenario], jobs: Sequence[SweepJob], reports: Mapping[str, Report]
) -> list[FaultRow]:
    """Make one row for each scenario that has a run, in their order.

    What the same drive of the same seed tells without a fault, too, is no sign of one.
    """
    rows = []
    for scenario in scenarios:
        found = _find_reports(scenario, jobs, reports)
        usual = _find_reports(_leave_out_fault(scenario), jobs, reports)
        if found:
            rows.append(_make_row(scenario, found, usual))
    return rows


def _find_reports(
    scenario: FaultScenario, jobs: Sequence[SweepJob], reports: Mapping[str, Report]
) -> dict[int, Report]:
    """Find the reports of a scenario by their seeds."""
    mine = (scenario.profile, scenario.list_settings())
    return {
        job.seed: reports[job.name]
        for job in jobs
        if job.name in reports and (job.profile, job.settings) == mine
    }


def _make_row(
    scenario: FaultScenario, found: Mapping[int, Report], usual: Mapping[int, Report]
) -> FaultRow:
    reports = tuple(found.values())
    ends = [r.reason.removeprefix(ENDED) for r in reports if r.reason.startswith(ENDED)]
    row = FaultRow(
        fault=scenario.name,
        profile=scenario.profile,
        sensors=scenario.sensors,
        has_camera=scenario.has_camera,
        is_detectable=scenario.is_detectable,
        platform=scenario.platform,
        runs=len(reports),
        outside_m_max=max(r.safety.outside_m_max or 0.0 for r in reports),
        stop_distance_m_max=max(r.safety.stop_distance_m_max or 0.0 for r in reports),
        plants=sum(r.tracking.plants_total or 0 for r in reports),
        ended_badly=len(ends),
        why_ended=_find_typical(ends),
    )
    if not scenario.fault:
        stops = [reason for report in reports for reason in list_false_stops(report)]
        return msgspec.structs.replace(
            row,
            reaction=f"{len(stops)} false stops",
            reason=_find_typical(stops),
            crushed_after=sum(r.tracking.plants_crushed or 0 for r in reports),
        )
    faults = [
        _leave_out_usual(fault, usual.get(seed))
        for seed, report in found.items()
        for fault in report.safety.faults
    ]
    if not faults:
        return msgspec.structs.replace(row, reaction="never began")
    return _add_verdicts(row, faults, reports)


def _leave_out_usual(fault: FaultReport, usual: Report | None) -> FaultReport:
    """Return a fault as not noticed where all that was told is told without it, too."""
    if usual is None:
        return fault
    told = {_mask(told.reason) for told in (*usual.safety.stops, *usual.safety.noticed)}
    if _mask(fault.reason) not in told:
        return fault
    return FaultReport(name=fault.name, t_s=fault.t_s, fault=fault.fault)


def _add_verdicts(
    row: FaultRow, faults: Sequence[FaultReport], reports: Sequence[Report]
) -> FaultRow:
    delays_s = [f.detected_s - f.t_s for f in faults if f.detected_s is not None]
    return msgspec.structs.replace(
        row,
        detected_ratio=len(delays_s) / len(faults),
        time_to_detect_s=statistics.median(delays_s) if delays_s else None,
        reaction=_find_typical([f.reaction for f in faults]),
        named_ratio=sum(f.is_named for f in faults) / len(faults),
        crushed_after=sum(r.safety.crushed_after_fault or 0 for r in reports),
        reason=_find_typical([f.reason for f in faults if f.reason]),
    )


def list_false_stops(report: Report) -> list[str]:
    """List the stops of a run without a fault, and how it failed."""
    reasons = [stop.reason for stop in report.safety.stops]
    is_failed = report.reason.startswith(("mission failed", ENDED))
    return [*reasons, report.reason] if is_failed else reasons


def _find_typical(texts: Iterable[str]) -> str:
    """Return the first of those that differ in numbers only and are the most."""
    first: dict[str, str] = {}
    counts: Counter[str] = Counter()
    for text in texts:
        masked = _mask(text)
        first.setdefault(masked, text)
        counts[masked] += 1
    return first[counts.most_common(1)[0][0]] if counts else ""


def _mask(text: str) -> str:
    return _NUMBER.sub("#", text)


def summarise_rows(
    rows: Sequence[FaultRow], jobs: Sequence[SweepJob], reports: Mapping[str, Report]
) -> dict[str, Any]:
    """Sum up the campaign in the keys of `--json`.

    Ratios count every run the same; `crushed_ratio` is the share of all crop plants of the runs
    with a fault that were crushed after it.
    """
    bad = [row for row in rows if row.fault != "no fault"]
    judged = [row for row in bad if row.detected_ratio is not None]
    count = sum(row.runs for row in judged)
    plants = sum(row.plants for row in bad)
    crushed = sum(row.crushed_after or 0 for row in bad)
    without = [job for job in jobs if "faults=[]" in job.settings and job.name in reports]
    return {
        "preset": PRESET,
        "faults": len(bad),
        "seeds": len({job.seed for job in jobs}),
        "detected_ratio": _average([(r.detected_ratio, r.runs) for r in judged], count),
        "named_ratio": _average([(r.named_ratio, r.runs) for r in judged], count),
        "crushed_after_detectable": sum(r.crushed_after or 0 for r in bad if r.is_detectable),
        "crushed_ratio": crushed / plants if plants else None,
        "outside_m_max": max((row.outside_m_max or 0.0 for row in bad), default=None),
        "false_stops": sum(len(list_false_stops(reports[job.name])) for job in without),
        "missions_without_fault": len(without),
        "ended_badly": sum(row.ended_badly for row in rows),
        "rows": msgspec.to_builtins(rows),
    }


def _average(values: Sequence[tuple[float | None, int]], count: int) -> float | None:
    return sum((value or 0.0) * runs for value, runs in values) / count if count else None


def format_table(rows: Sequence[FaultRow]) -> str:
    """Format one line for each scenario; "-" where nothing was measured."""
    lines = [
        "| fault | drive | runs | detected | after | reaction | rolled | named | crushed | outside | it said |",  # noqa: E501
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        said = row.reason or "-"
        if row.ended_badly:
            said = f"{said}; {row.ended_badly} ended by: {row.why_ended}"
        cells = (
            f"`{row.fault}`" if row.fault != "no fault" else row.fault,
            _name_drive(row),
            str(row.runs),
            _format(row.detected_ratio, 100.0, " %", 0),
            _format(row.time_to_detect_s, 1.0, " s", 2),
            row.reaction,
            _format(row.stop_distance_m_max, 1.0, " m", 2),
            _format(row.named_ratio, 100.0, " %", 0),
            "-" if row.crushed_after is None else str(row.crushed_after),
            _format(row.outside_m_max, 1.0, " m", 1),
            said.replace("|", "\\|").replace("\n", " ")[:160],
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _format(value: float | None, scale: float, unit: str, digits: int) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}{unit}"
