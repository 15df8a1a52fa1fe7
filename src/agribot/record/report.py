"""The report of a run as numbers. A value that was not measured is null, never 0."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import msgspec

from agribot.core.encounter import Encounter
from agribot.core.errors import CHECK_DISK, RecordingError, explain_os_error, explain_unreadable
from agribot.core.facts import ComingAndGoing
from agribot.core.implement.kind import ReportLine
from agribot.core.implement.row_shares import TreatedShare
from agribot.core.whole_file import write_at_once
from agribot.record.dropout_watch import Dropouts


class TimeReport(msgspec.Struct, frozen=True, kw_only=True):
    """`rtf_cpu` is simulated seconds per CPU second; `wall_s` includes any pacing."""

    sim_s: float | None = None
    wall_s: float | None = None
    cpu_s: float | None = None
    rtf_cpu: float | None = None


class MissionReport(msgspec.Struct, frozen=True, kw_only=True):
    """`rows_unproven` are rows, counted from 1, that were driven without evidence: not done."""

    success: bool | None = None
    rows_total: int | None = None
    rows_done: int | None = None
    waypoints_total: int | None = None
    waypoints_reached: int | None = None
    distance_m: float | None = None
    area_m2: float | None = None
    h_per_ha: float | None = None
    coverage_ratio: float | None = None
    rows_unproven: tuple[int, ...] | None = None


class FoundRowsReport(msgspec.Struct, frozen=True, kw_only=True):
    """Rows that the robot found by itself, `file` where it drew them; the rest by the truth.

    `invented` are found rows where none stands. Offsets are across, end errors along the rows.
    """

    found: int | None = None
    true: int | None = None
    matched: int | None = None
    invented: int | None = None
    offset_rms_m: float | None = None
    offset_m_max: float | None = None
    end_error_m_max: float | None = None
    file: str | None = None


class CrushedReport(msgspec.Struct, frozen=True, kw_only=True):
    """Count of crop plants crushed by each part of the robot."""

    wheel: int | None = None
    belly: int | None = None
    implement: int | None = None


class TrackingReport(msgspec.Struct, frozen=True, kw_only=True):
    """Against the truth of a simulator. A brushed plant was touched, and lives."""

    xte_rms_m: float | None = None
    xte_p95_m: float | None = None
    xte_max_m: float | None = None
    heading_rms_rad: float | None = None
    plants_total: int | None = None
    plants_crushed: int | None = None
    plants_crushed_by: CrushedReport = CrushedReport()
    plants_brushed: int | None = None


class EstimateReport(msgspec.Struct, frozen=True, kw_only=True):
    """Against the truth of a simulator; an honest 3-D filter has a NEES of about 3."""

    pos_rms_m: float | None = None
    yaw_rms_rad: float | None = None
    nees_mean: float | None = None


class IouReport(msgspec.Struct, frozen=True, kw_only=True):
    """Intersection over union of each class, by pixels."""

    weed: float | None = None
    crop: float | None = None
    soil: float | None = None


class PerceptionReport(msgspec.Struct, frozen=True, kw_only=True):
    """`to_tool_p95_s` is from the capture of a picture until the tool can move for it."""

    frames: int | None = None
    fps_cpu: float | None = None
    latency_p95_s: float | None = None
    to_tool_p95_s: float | None = None
    iou: IouReport = IouReport()
    miou: float | None = None


class WeedReport(msgspec.Struct, frozen=True, kw_only=True):
    """Plants along the finished rows; without a word of crops or stems a figure is of the weeds.

    `stem_error_p95_m` is the distance of matched plants of both classes from their true stems,
    `placement_p90_m` that of matched weeds. `left` counts the mapped weeds that were not treated by
    the reason, `crop_leaves_wet_ratio` is the share of the crops' leaf area that got wet, and
    `tool_offset_p50_m` how near the middle of an open nozzle came to the weeds within 10 cm of it.
    `in_row` are the weeds nearer than 15 cm to a row's line, `between_rows` the others: true ones
    of a simulator, mapped ones in a real field. `untreated` counts the true weeds of all rows,
    finished or not, that were not treated, by the reason.
    """

    truth: int | None = None
    mapped: int | None = None
    matched: int | None = None
    precision: float | None = None
    recall: float | None = None
    f1: float | None = None
    pos_error_median_m: float | None = None
    treated: int | None = None
    treated_true: int | None = None
    crops_hit: int | None = None
    spray_area_ratio: float | None = None
    crops_truth: int | None = None
    crops_mapped: int | None = None
    crop_recall: float | None = None
    stem_error_p95_m: float | None = None
    placement_p90_m: float | None = None
    left: dict[str, int] | None = None
    crop_leaves_wet_ratio: float | None = None
    tool_offset_p50_m: float | None = None
    tool_offset_p90_m: float | None = None
    in_row: TreatedShare | None = None
    between_rows: TreatedShare | None = None
    untreated: dict[str, int] | None = None


class ImplementReport(msgspec.Struct, frozen=True, kw_only=True):
    """Work of the implement; `verb` says it of a weed: "sprayed".

    The worked ground is the truth of a simulator, the lines are what the implement believes.
    """

    kind: str
    verb: str
    width_m: float
    worked_m2: float | None = None
    worked_area_ratio: float | None = None
    lines: tuple[ReportLine, ...] = ()


class SafetyEvent(msgspec.Struct, frozen=True, kw_only=True):
    """A stop, refusal or fault; `code`, `parts` and `numbers` are those of its fact, if any."""

    t_s: float
    reason: str
    code: str = ""
    parts: tuple[str, ...] = ()
    numbers: dict[str, float] = {}


Reaction = Literal["stopped", "held", "slowed", "named", "none"]


class FaultReport(msgspec.Struct, frozen=True, kw_only=True):
    """Reaction of the robot to a fault that was injected at `t_s`.

    `detected_s` is the time of the first sign of it among the events, `reaction` the strongest of
    them, `reason` what the robot said then, of the part at fault if it did. `is_named`: some
    reason names that part alone; `is_one_of_two`: reasons name it only beside another. `fault` is
    the whole of it, as it was written. `code`, `parts` and `numbers` belong to the reason.
    """

    name: str
    t_s: float
    detected_s: float | None = None
    reaction: Reaction = "none"
    reason: str = ""
    fault: str = ""
    is_named: bool = False
    is_one_of_two: bool = False
    code: str = ""
    parts: tuple[str, ...] = ()
    numbers: dict[str, float] = {}


CrushedWhen = Literal["before_detection", "after_detection", "after_standstill", "by_fault"]


class CrushReport(msgspec.Struct, frozen=True, kw_only=True):
    """A crop that was crushed after the first fault began, by wheel, belly or implement.

    `when` counts from the first sign of a fault, and from when the robot came to rest after it;
    `by_fault` is crushed where hands set the robot down.
    """

    t_s: float
    by: str
    when: CrushedWhen


class SafetyReport(msgspec.Struct, frozen=True, kw_only=True):
    """`noticed` are the faults that the robot reported, `faults` those that were injected.

    `gate` are the changes of the supervisor's state, `checks` what the list before a start found.
    By the truth of a simulator: `outside_m_max` is how far any place of the robot, implement
    included, got out of the field, `stop_distance_m_max` how far it rolled after a stop of the
    supervisor, `stop_allowed_m` what its drive promises at the speed of that stop, and
    `stops_too_long` how many stops took more than that; `person_distance_min_m` is how near its
    outline came to a person's.

    `interventions` are the stops, pauses and questions that only a person could end;
    `km_per_intervention` is null where there were none. The way is the true one, or on a real
    robot the way that it believes to have driven. `dropouts` are the short silences by part, whose
    names are those of the fact `comes_and_goes`, of this run alone. `waits_for_obstacles`
    counts how often it stood because something was in its way. `over_level_ratio` is the share of
    the time with a good estimate in which its true error was above its protection level.
    """

    stops: tuple[SafetyEvent, ...] = ()
    noticed: tuple[SafetyEvent, ...] = ()
    faults: tuple[FaultReport, ...] = ()
    outside_m_max: float | None = None
    stop_distance_m_max: float | None = None
    crushed_after_fault: int | None = None
    person_distance_min_m: float | None = None
    gate: tuple[SafetyEvent, ...] = ()
    checks: tuple[SafetyEvent, ...] = ()
    stop_allowed_m: float | None = None
    stops_too_long: int | None = None
    crushes: tuple[CrushReport, ...] = ()
    interventions: tuple[SafetyEvent, ...] = ()
    km_per_intervention: float | None = None
    dropouts: dict[ComingAndGoing, Dropouts] | None = None
    waits_for_obstacles: int = 0
    visits: tuple[Encounter, ...] = ()
    over_level_ratio: float | None = None


class BeliefReport(msgspec.Struct, frozen=True, kw_only=True):
    """The robot's account beside a simulator's; null where the truth is unknown.

    What is believed of an error is the root mean square of the 1 sigma that the robot stated.
    """

    what: str
    unit: str = ""
    believed: float | None = None
    known: float | None = None


class RunOfJob(msgspec.Struct, frozen=True, kw_only=True):
    """One of the runs that did a job, and how long it ran until it was cut off or ended."""

    folder: str
    run_s: float


class JobReport(msgspec.Struct, frozen=True, kw_only=True):
    """A job in several runs, this one last; `lacks` is the lost part of the earlier ones."""

    runs: tuple[RunOfJob, ...]
    lacks: tuple[str, ...] = ()


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """`report.json`, key by key and in this order: of the whole job, also in several runs.

    `conditions` are what the seed drew from `preset` of the simulated world; null of a real one,
    and of a world that is as its file says.
    """

    profile: str
    seed: int
    sensors: str
    version: str
    ok: bool
    reason: str
    time: TimeReport = TimeReport()
    mission: MissionReport = MissionReport()
    tracking: TrackingReport = TrackingReport()
    estimate: EstimateReport = EstimateReport()
    perception: PerceptionReport = PerceptionReport()
    weeds: WeedReport = WeedReport()
    safety: SafetyReport = SafetyReport()
    marks: tuple[SafetyEvent, ...] = ()
    job: JobReport | None = None
    implement: ImplementReport | None = None
    preset: str | None = None
    conditions: dict[str, Any] | None = None
    beliefs: tuple[BeliefReport, ...] = ()
    found_rows: FoundRowsReport | None = None


def to_json(report: Report) -> bytes:
    """Encode with indentation; a number that is not finite becomes null."""
    return msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n"


def write_report(path: Path, report: Report) -> None:
    """Write report.json.

    Raises: RecordingError: the file cannot be written.
    """
    write_file(path, to_json(report))


def read_report(path: Path) -> Report:
    """Read report.json.

    Raises: RecordingError: no such file, or it is no report of this version.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=Report)
    except OSError as error:
        raise RecordingError(explain_unreadable(path, error)) from error
    except msgspec.MsgspecError as error:
        raise RecordingError(
            f"{path} is not a run report of this version: {error}; make it anew with agribot report"
        ) from error


def write_file(path: Path, data: bytes) -> None:
    """Write a file of the run's folder, which is made if it is not there.

    An older file stays whole until the new one is; see `write_at_once` for links and pipes.
    Raises: RecordingError: it cannot be written.
    """
    with explain_os_error(f"cannot write {path}", CHECK_DISK):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_at_once(path, data)
