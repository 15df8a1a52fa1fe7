"""The report of a run, put together from what the robot believed and what the referee saw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

import msgspec

from agribot.app.beliefs import ReportParts, compare, compute_worked_ratio
from agribot.app.interventions import compute_km_per_intervention, list_interventions
from agribot.app.judge import Judge
from agribot.app.unattended import INTERRUPTED
from agribot.app.whole_job import JobSoFar, WholeJob
from agribot.autonomy.plan.mission.row_log import RowResult
from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import RunConfig
from agribot.core.facts import ObstacleInWay
from agribot.core.implement.left_weeds import (
    ENDED_BY_OPERATOR,
    ROW_NOT_DRIVEN,
    RUN_ENDED,
    Passage,
    count_left,
)
from agribot.core.implement.row_shares import share_by_rows
from agribot.core.messages import MappedPlant, MissionStatus, Row, TickRecord
from agribot.core.platforms import find_platform
from agribot.core.robot import RobotSpec
from agribot.core.version import __version__
from agribot.record.events import Event, EventKind, EventLog
from agribot.record.report import (
    BeliefReport,
    CrushReport,
    EstimateReport,
    FaultReport,
    FoundRowsReport,
    ImplementReport,
    IouReport,
    JobReport,
    MissionReport,
    PerceptionReport,
    Report,
    SafetyEvent,
    SafetyReport,
    TimeReport,
    TrackingReport,
    WeedReport,
)
from agribot.record.run_files import DRAWN_FILE

Kind = TypeVar("Kind", bound=msgspec.Struct)


class EndedRun(Protocol):
    """The parts of a finished run that the report needs."""

    config: RunConfig
    robot: RobotSpec
    last: TickRecord | None
    judge: Judge | None
    job: WholeJob
    event_log: EventLog
    rows_before: tuple[int, ...]  # done in earlier runs; nothing else is known of those

    @property
    def conditions(self) -> dict[str, Any] | None: ...
    @property
    def finds_rows(self) -> bool: ...
    @property
    def weed_map(self) -> WeedMap: ...
    @property
    def rows(self) -> tuple[Row, ...]: ...
    @property
    def row_results(self) -> tuple[RowResult, ...]: ...
    def worked_area_m2(self, rows: tuple[int, ...]) -> float: ...


def report_card(drive: EndedRun, why_ended: str = "") -> Report:
    """Report what was done: by the truth where a judge knows it, else as the robot believes.

    Without a judge, all that needs the truth is null. `why_ended` names an end from outside: an
    interruption or the end of the time allowed.
    """
    config, judge, job = drive.config, drive.judge, drive.job.snapshot()
    status = drive.last.status if drive.last is not None else None
    done = status.rows_done if status else ()
    kept = (*drive.rows_before, *(done if judge is None else judge.list_rows_kept(done)))
    mission = _mission(drive, job, status, kept)
    events = drive.job.events(drive.event_log.events)
    tracking = TrackingReport()
    if judge is not None:
        tracking = msgspec.convert(msgspec.to_builtins(judge.score_tracking()), TrackingReport)
    found = _found_rows(drive)
    ok = bool(mission.success) and not tracking.plants_crushed and not why_ended
    ok = ok and not _name_missed(found)
    report = Report(
        profile=config.profile,
        seed=config.seed,
        sensors=config.sim.sensors,
        version=__version__,
        ok=ok,
        reason=(
            why_ended
            or _reason(status, mission, tracking)
            + _objection(drive.event_log, status)
            + _name_missed(found)
        )
        + _lacking(job),
        time=_time(job),
        mission=mission,
        tracking=tracking,
        estimate=(
            EstimateReport()
            if judge is None
            else _same_fields(judge.score_estimate(), EstimateReport)
        ),
        perception=_perception(drive, job),
        weeds=_weeds(drive, job, kept, explain_not_driven(status, why_ended)),
        implement=_implement(drive, job, kept),
        safety=_safety(drive, job, mission, events),
        marks=_select_events(events, "mark"),
        job=JobReport(runs=job.runs, lacks=job.lacks) if len(job.runs) > 1 or job.lacks else None,
        preset=config.sim.preset if find_platform(config.platform).is_simulated else None,
        conditions=drive.conditions,
        found_rows=found,
    )
    return msgspec.structs.replace(report, beliefs=_beliefs(drive, job, report, done))


def _beliefs(
    drive: EndedRun, job: JobSoFar, report: Report, done: Sequence[int]
) -> tuple[BeliefReport, ...]:
    weeds = drive.weed_map.weeds() if report.weeds.mapped else ()
    return compare(
        job.believed,
        ReportParts(
            rows_done=len({*drive.rows_before, *done}),
            worked_ratio=compute_worked_ratio(drive.row_results, drive.rows),
            confidence=sum(w.confidence for w in weeds) / len(weeds) if weeds else None,
            mission=report.mission,
            tracking=report.tracking,
            estimate=report.estimate,
            weeds=report.weeds,
            has_judge=drive.judge is not None,
        ),
    )


def _found_rows(drive: EndedRun) -> FoundRowsReport | None:
    """Report the rows that the robot found by itself; None where it was given them."""
    if not drive.finds_rows:
        return None
    driven = drive.rows
    score = None if drive.judge is None else drive.judge.score_found_rows(driven)
    found = FoundRowsReport() if score is None else _same_fields(score, FoundRowsReport)
    file = DRAWN_FILE if driven else None
    return msgspec.structs.replace(found, found=len(driven), file=file)


def _name_missed(found: FoundRowsReport | None) -> str:
    """Name the rows that were not found, or found where no row stands; empty if all is well."""
    if found is None or found.matched is None or found.true is None:
        return ""
    missed = [f"{found.true - found.matched} of {found.true} rows not found"]
    missed = missed if found.matched < found.true else []
    missed += [f"{found.invented} found where none stands"] if found.invented else []
    return "; " + ", ".join(missed) if missed else ""


def _lacking(job: JobSoFar) -> str:
    """List what is unknown of the runs before this one."""
    return f"; of the job's earlier runs the report lacks {'; '.join(job.lacks)}" * bool(job.lacks)


def _reason(status: MissionStatus | None, mission: MissionReport, tracking: TrackingReport) -> str:
    if status is None:
        return "the robot never ran"
    if status.state != "done":
        return f"mission {status.state}: {status.reason}" if status.reason else status.state
    kind, done, total = "rows", mission.rows_done, mission.rows_total
    if mission.waypoints_total:
        kind, done, total = "waypoints", mission.waypoints_reached, mission.waypoints_total
    if done != total:
        return f"the robot believes all is done, but in truth only {done} of {total} {kind}"
    if tracking.plants_crushed is None:
        return f"{done} of {total} {kind}, as the robot believes"
    if tracking.plants_crushed:
        crushed = f"{tracking.plants_crushed} crop plants were crushed{_blame(tracking)}"
        return f"{done} of {total} {kind}, but {crushed}"
    return f"{done} of {total} {kind}, no plant crushed"


def _blame(tracking: TrackingReport) -> str:
    """Say what crushed them: " by the belly", " (4 by wheels, 2 by the belly)"."""
    by = tracking.plants_crushed_by
    words = ("wheels", by.wheel), ("the belly", by.belly), ("the implement", by.implement)
    found = [(what, count) for what, count in words if count]
    if len(found) == 1:
        return f" by {found[0][0]}"
    return f" ({', '.join(f'{count} by {what}' for what, count in found)})" if found else ""


def _objection(log: EventLog, status: MissionStatus | None) -> str:
    """Return the supervisor's reason, where it still held the robot when the mission failed."""
    if status is None or status.state != "failed":
        return ""
    spoken = [
        event
        for event in log.events
        if event.kind in ("stop", "hold") or (event.kind == "clear" and not event.reason)
    ]
    held = [e for e in spoken if e.kind != "clear" or e.t_s < log.events[-1].t_s][-1:]
    return f"; held by the supervisor: {held[0].reason}" if held and held[0].reason else ""


def _mission(
    drive: EndedRun, job: JobSoFar, status: MissionStatus | None, kept: tuple[int, ...]
) -> MissionReport:
    """Report what was requested and what was done; rows and waypoints exclude each other."""
    if status is None:
        return MissionReport(success=False)
    judge = drive.judge
    distance_m = None if judge is None else judge.score_tracking().distance_m
    if status.waypoints_total:
        reached = status.waypoints_reached
        if judge is not None:
            reached = judge.count_waypoints_kept(drive.config.mission.waypoint_radius_m)
        return MissionReport(
            success=status.state == "done" and reached == status.waypoints_total,
            waypoints_total=status.waypoints_total,
            waypoints_reached=reached,
            distance_m=distance_m,
        )
    area_m2 = drive.worked_area_m2(kept)
    return MissionReport(
        success=status.state == "done" and len(kept) == status.rows_total,
        rows_total=status.rows_total,
        rows_done=len(kept),
        distance_m=distance_m,
        area_m2=area_m2,
        h_per_ha=job.sim_s / 3600.0 / (area_m2 / 1e4) if area_m2 else None,
        coverage_ratio=None if judge is None else judge.compute_coverage_ratio(),
        rows_unproven=tuple(sorted(row + 1 for row in status.rows_unproven)),
    )


def _time(job: JobSoFar) -> TimeReport:
    return TimeReport(
        sim_s=job.sim_s,
        wall_s=job.wall_s,
        cpu_s=job.cpu_s,
        rtf_cpu=job.sim_s / job.cpu_s if job.cpu_s else None,
    )


def _perception(drive: EndedRun, job: JobSoFar) -> PerceptionReport:
    if not job.frames:
        return PerceptionReport()
    iou = IouReport() if drive.judge is None else IouReport(**drive.judge.compute_iou())
    known = [value for value in (iou.weed, iou.crop, iou.soil) if value is not None]
    return PerceptionReport(
        frames=job.frames,
        fps_cpu=job.frames / job.frames_cpu_s if job.frames_cpu_s else None,
        latency_p95_s=job.latency_s.percentile(95.0),
        to_tool_p95_s=_find_to_tool_s(drive, job),
        iou=iou,
        miou=sum(known) / len(known) if known else None,
    )


def _find_to_tool_s(drive: EndedRun, job: JobSoFar) -> float | None:
    """Return how long a picture takes to move the tool; None without one, or without pictures."""
    used_s, spec = job.used_s.percentile(95.0), drive.robot.implement
    return None if used_s is None or spec is None else used_s + spec.latency_s


def explain_not_driven(status: MissionStatus | None, why_ended: str) -> str:
    """Say why ground of the rows was not driven."""
    state = None if status is None else status.state
    if why_ended == INTERRUPTED or state == "cancelled":
        return ENDED_BY_OPERATOR
    return ROW_NOT_DRIVEN if state == "done" else RUN_ENDED


def _weeds(drive: EndedRun, job: JobSoFar, kept: tuple[int, ...], not_driven: str) -> WeedReport:
    if not job.frames or not drive.rows:
        return WeedReport()
    weeds, crops, spec = drive.weed_map.weeds(), drive.weed_map.crops(), drive.robot.implement
    if drive.judge is None:
        return _count_mapped(drive, weeds, len(crops), kept, not_driven)
    score = drive.judge.score_weeds(weeds, crops, kept, not_driven)
    is_wet = spec is not None and spec.wets_ground
    return msgspec.structs.replace(
        _same_fields(score, WeedReport),
        spray_area_ratio=score.worked_area_ratio if is_wet else None,
    )


def _count_mapped(
    drive: EndedRun, weeds: Sequence[MappedPlant], crops: int, kept: tuple[int, ...],
    not_driven: str,
) -> WeedReport:  # fmt: skip
    """Count what the map of a real field says, whose truth is unknown."""
    spec = drive.robot.implement
    passage = Passage(
        drive.rows,
        lambda row, _along_m: row.index in kept,
        None if spec is None else spec.width_m,
        not_driven,
    )
    places = [(weed.x_map_m, weed.y_map_m, weed.treated_s is not None) for weed in weeds]
    in_row, between_rows = share_by_rows(places, drive.rows)
    return WeedReport(
        mapped=len(weeds),
        crops_mapped=crops,
        treated=in_row.treated + between_rows.treated,
        left=count_left(weeds, passage),
        in_row=in_row,
        between_rows=between_rows,
    )


def _implement(drive: EndedRun, job: JobSoFar, kept: tuple[int, ...]) -> ImplementReport | None:
    spec, judge = drive.robot.implement, drive.judge
    if spec is None:
        return None
    return ImplementReport(
        kind=spec.kind,
        verb=spec.verb,
        width_m=spec.width_m,
        worked_m2=None if judge is None else judge.worked_m2,
        worked_area_ratio=None if judge is None else judge.compute_worked_area_ratio(kept),
        lines=job.implement,
    )


def _safety(
    drive: EndedRun, job: JobSoFar, mission: MissionReport, events: Sequence[Event]
) -> SafetyReport:
    distance_m = job.believed.distance_m if drive.judge is None else mission.distance_m
    interventions = list_interventions(events)
    faults, crushes = tuple[FaultReport, ...](), tuple[CrushReport, ...]()
    safety = SafetyReport()
    if drive.config.faults:
        from agribot.app.fault_verdict import judge_faults

        faults = judge_faults(drive.config.faults, events)
    if drive.judge is not None:
        from agribot.app.fault_verdict import judge_crushes

        score = drive.judge.score_safety()
        crushes = judge_crushes(drive.config.faults, faults, score.crushes, score.stood_s)
        safety = _same_fields(msgspec.structs.replace(score, crushes=()), SafetyReport)
    return msgspec.structs.replace(
        safety,
        stops=_select_events(events, "stop"),
        noticed=_select_events(events, "fault"),
        faults=faults,
        gate=_select_events(events, "gate"),
        checks=_select_events(events, "check"),
        crushes=crushes,
        interventions=interventions,
        km_per_intervention=compute_km_per_intervention(distance_m, len(interventions)),
        dropouts=drive.event_log.dropouts,
        waits_for_obstacles=_count_waits(events),
    )


def _count_waits(events: Sequence[Event]) -> int:
    """Count how often the gate began to hold the robot for something in its way."""
    return sum(event.kind == "gate" and event.code == ObstacleInWay(0.0).code for event in events)


def _select_events(events: Sequence[Event], kind: EventKind) -> tuple[SafetyEvent, ...]:
    return tuple(_same_fields(event, SafetyEvent) for event in events if event.kind == kind)


def _same_fields(source: msgspec.Struct, kind: type[Kind]) -> Kind:
    return msgspec.convert(
        {name: getattr(source, name) for name in kind.__struct_fields__ if hasattr(source, name)},
        kind,
    )
