"""The report of a run, put together from what the robot believed and what the referee saw."""

from __future__ import annotations

import time
from typing import Protocol, TypeVar

import msgspec

from agribot import __version__
from agribot.config import RunConfig
from agribot.messages import MissionStatus, TickRecord
from agribot.perception_host import PerceptionMeter
from agribot.record.events import EventKind, EventLog
from agribot.record.report import (
    EstimateReport,
    IouReport,
    MissionReport,
    PerceptionReport,
    Report,
    SafetyEvent,
    SafetyReport,
    TimeReport,
    TrackingReport,
    WeedReport,
)
from agribot.sim.referee import Referee
from agribot.weeds.map import WeedMap

Kind = TypeVar("Kind", bound=msgspec.Struct)


class Clock:
    """Wall and CPU time of this process while a run drives."""

    def __init__(self) -> None:
        self._started: tuple[float, float] | None = None
        self.wall_s = self.cpu_s = 0.0

    def start(self) -> None:
        self._started = (time.monotonic(), time.process_time())

    def stop(self) -> None:
        if self._started is not None:
            self.wall_s += time.monotonic() - self._started[0]
            self.cpu_s += time.process_time() - self._started[1]
            self._started = None


class Drive(Protocol):
    """What the report needs of a session that has come to its end."""

    config: RunConfig
    last: TickRecord | None
    referee: Referee
    clock: Clock
    event_log: EventLog
    rows_before: tuple[int, ...]  # done before this run took over

    @property
    def meter(self) -> PerceptionMeter | None: ...
    @property
    def weed_map(self) -> WeedMap: ...
    def worked_area_m2(self, rows: tuple[int, ...]) -> float: ...


def report_card(drive: Drive, why_ended: str = "") -> Report:
    """`why_ended` names an end from outside: an interruption or the end of the time allowed."""
    config, referee = drive.config, drive.referee
    status = drive.last.status if drive.last is not None else None
    kept = (*drive.rows_before, *referee.rows_kept(status.rows_done if status else ()))
    mission = _mission(drive, status, kept)
    tracking = referee.tracking()
    ok = bool(mission.success) and tracking.plants_crushed == 0 and not why_ended
    return Report(
        profile=config.profile,
        seed=config.seed,
        sensors=config.sim.sensors,
        version=__version__,
        ok=ok,
        reason=why_ended
        or _reason(status, mission, tracking.plants_crushed) + _objection(drive.event_log, status),
        time=_time(drive),
        mission=mission,
        tracking=_same_fields(tracking, TrackingReport),
        estimate=_same_fields(referee.estimate(), EstimateReport),
        perception=_perception(drive),
        weeds=_weeds(drive, kept),
        safety=_safety(drive.event_log),
        marks=_told(drive.event_log, "mark"),
    )


def _reason(status: MissionStatus | None, mission: MissionReport, crushed: int) -> str:
    if status is None:
        return "the robot never ran"
    if status.state != "done":
        return f"mission {status.state}: {status.reason}" if status.reason else status.state
    kind, done, total = "rows", mission.rows_done, mission.rows_total
    if mission.waypoints_total:
        kind, done, total = "waypoints", mission.waypoints_reached, mission.waypoints_total
    if done != total:
        return f"the robot believes all is done, but in truth only {done} of {total} {kind}"
    if crushed:
        return f"{done} of {total} {kind}, but {crushed} crop plants were crushed"
    return f"{done} of {total} {kind}, no plant crushed"


def _objection(log: EventLog, status: MissionStatus | None) -> str:
    """The supervisor's last word, where it was still holding the robot when the mission failed."""
    if status is None or status.state != "failed":
        return ""
    spoken = [event for event in log.events if event.kind in ("stop", "hold", "clear")]
    held = [e for e in spoken if e.kind != "clear" or e.t_s < log.events[-1].t_s][-1:]
    return f"; held by the supervisor: {held[0].reason}" if held and held[0].reason else ""


def _mission(drive: Drive, status: MissionStatus | None, kept: tuple[int, ...]) -> MissionReport:
    """What was asked and what was truly done; rows and waypoints exclude each other."""
    if status is None:
        return MissionReport(success=False)
    distance_m = drive.referee.tracking().distance_m
    if status.waypoints_total:
        reached = drive.referee.waypoints_kept(drive.config.mission.waypoint_radius_m)
        return MissionReport(
            success=status.state == "done" and reached == status.waypoints_total,
            waypoints_total=status.waypoints_total,
            waypoints_reached=reached,
            distance_m=distance_m,
        )
    area_m2 = drive.worked_area_m2(kept)
    sim_s = drive.last.batch.t_s if drive.last is not None else 0.0
    return MissionReport(
        success=status.state == "done" and len(kept) == status.rows_total,
        rows_total=status.rows_total,
        rows_done=len(kept),
        distance_m=distance_m,
        area_m2=area_m2,
        h_per_ha=sim_s / 3600.0 / (area_m2 / 1e4) if area_m2 else None,
        coverage_ratio=drive.referee.coverage_ratio(),
    )


def _time(drive: Drive) -> TimeReport:
    sim_s = drive.last.batch.t_s if drive.last is not None else 0.0
    clock = drive.clock
    return TimeReport(
        sim_s=sim_s,
        wall_s=clock.wall_s,
        cpu_s=clock.cpu_s,
        rtf_cpu=sim_s / clock.cpu_s if clock.cpu_s else None,
    )


def _perception(drive: Drive) -> PerceptionReport:
    meter = drive.meter
    if meter is None or not meter.frames:
        return PerceptionReport()
    iou = drive.referee.iou()
    known = [value for value in iou.values() if value is not None]
    return PerceptionReport(
        frames=meter.frames,
        fps_cpu=meter.frames_per_cpu_s,
        latency_p95_s=meter.latency_p95_s,
        iou=IouReport(**iou),
        miou=sum(known) / len(known) if known else None,
    )


def _weeds(drive: Drive, kept: tuple[int, ...]) -> WeedReport:
    if drive.meter is None or not drive.referee.has_rows:
        return WeedReport()
    return _same_fields(drive.referee.weeds(drive.weed_map.weeds(), kept), WeedReport)


def _safety(log: EventLog) -> SafetyReport:
    return SafetyReport(stops=_told(log, "stop"), faults=_told(log, "fault"))


def _told(log: EventLog, kind: EventKind) -> tuple[SafetyEvent, ...]:
    return tuple(SafetyEvent(t_s=e.t_s, reason=e.reason) for e in log.of_kind(kind))


def _same_fields(source: msgspec.Struct, kind: type[Kind]) -> Kind:
    return msgspec.convert(
        {name: getattr(source, name, None) for name in kind.__struct_fields__}, kind
    )
