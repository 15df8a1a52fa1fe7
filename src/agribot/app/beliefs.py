"""What the robot believes of a job, summed up to stand beside what is known of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from agribot.autonomy.plan.mission.row_log import RowResult
from agribot.core.arithmetic import clamp
from agribot.core.messages import Row, TickRecord
from agribot.core.row_shape import row_length_m
from agribot.record.report import (
    BeliefReport,
    EstimateReport,
    MissionReport,
    TrackingReport,
    WeedReport,
)

LONGEST_TICK_S = 0.5  # longest gap between two ticks that a belief outlasts


class BeliefSums(msgspec.Struct, kw_only=True):
    """Sums over the ticks of a job; `stated` are the squares of the reported 1 sigma."""

    distance_m: float = 0.0
    row_ticks: int = 0
    across_m2: float = 0.0
    across_max_m: float = 0.0
    estimate_ticks: int = 0
    stated_m2: float = 0.0
    stated_rad2: float = 0.0

    def add(self, record: TickRecord, dt_s: float) -> None:
        """Add a tick that came `dt_s` after the one before it."""
        estimate, tracking = record.estimate, record.tracking
        if not estimate.ok:
            return
        self.distance_m += abs(estimate.v_mps) * clamp(dt_s, 0.0, LONGEST_TICK_S)
        self.estimate_ticks += 1
        self.stated_m2 += estimate.pose_cov[0] + estimate.pose_cov[4]
        self.stated_rad2 += estimate.pose_cov[8]
        if tracking is not None and record.status.row >= 0:
            self.row_ticks += 1
            self.across_m2 += tracking.cross_track_m**2
            self.across_max_m = max(self.across_max_m, abs(tracking.cross_track_m))


class ReportParts(msgspec.Struct, frozen=True, kw_only=True):
    """The compared values: the rows that the robot calls done, and the parts of the report."""

    rows_done: int
    worked_ratio: float | None
    confidence: float | None  # mean of the mapped weeds
    mission: MissionReport
    tracking: TrackingReport
    estimate: EstimateReport
    weeds: WeedReport
    has_judge: bool


def compare(sums: BeliefSums, parts: ReportParts) -> tuple[BeliefReport, ...]:
    """List what the robot believes beside what is known; rows that do not apply are left out."""
    mission, tracking, estimate, weeds = (
        parts.mission, parts.tracking, parts.estimate, parts.weeds,
    )  # fmt: skip
    known = parts.has_judge
    rows = [
        _row("rows done", "", parts.rows_done, mission.rows_done if known else None),
        _row("share of the rows worked", "", parts.worked_ratio, mission.coverage_ratio),
        _row("way driven", "m", sums.distance_m, mission.distance_m),
        _row("cross-track error, RMS", "m", _root(sums.across_m2, sums.row_ticks),
             tracking.xte_rms_m),
        _row("cross-track error, largest", "m", sums.across_max_m if sums.row_ticks else None,
             tracking.xte_max_m),
        _row("error of the position, RMS", "m", _root(sums.stated_m2, sums.estimate_ticks),
             estimate.pos_rms_m),
        _row("error of the heading, RMS", "rad", _root(sums.stated_rad2, sums.estimate_ticks),
             estimate.yaw_rms_rad),
        _row("weeds along the rows", "", weeds.mapped, weeds.truth),
        _row("share of mapped weeds that are weeds", "", parts.confidence, weeds.precision),
        _row("weeds treated", "", weeds.treated, weeds.treated_true),
        _row("crop plants crushed", "", None, tracking.plants_crushed),
        _row("crop plants hit by the implement", "", None, weeds.crops_hit),
    ]  # fmt: skip
    if not mission.rows_total:
        rows = rows[2:]
    return tuple(row for row in rows if row.believed is not None or row.known is not None)


def compute_worked_ratio(results: Sequence[RowResult], rows: Sequence[Row]) -> float | None:
    """Divide the length that the robot believes to have worked by that of all rows."""
    length_m = {row.index: row_length_m(row) for row in rows}
    total_m = sum(length_m.values())
    worked_m = sum(min(one.worked_m, length_m.get(one.index, 0.0)) for one in results)
    return worked_m / total_m if total_m else None


def _row(what: str, unit: str, believed: float | None, known: float | None) -> BeliefReport:
    stated, true = (None if value is None else float(value) for value in (believed, known))
    return BeliefReport(what=what, unit=unit, believed=stated, known=true)


def _root(total: float, count: int) -> float | None:
    return math.sqrt(total / count) if count else None
