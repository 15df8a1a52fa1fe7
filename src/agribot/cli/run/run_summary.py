"""What a person wants to know first of a run that has ended, as lines of text."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from agribot.core.implement.row_shares import TreatedShare
    from agribot.record.report import MissionReport, Report, TrackingReport, WeedReport


def format_summary(report: Report, out_dir: Path) -> str:
    """Format what a person wants to know first; a line that does not apply is left out."""
    mission, tracking, weeds, spent = report.mission, report.tracking, report.weeds, report.time
    lines = [f"{'OK' if report.ok else 'NOT OK'}: {report.reason}"]
    if done := _format_drive(mission, tracking):
        lines.append(done)
    if report.safety.person_distance_min_m is not None:
        nearest_m = _format_number(report.safety.person_distance_min_m, unit=" m")
        lines.append(f"nearest to a person {nearest_m}")
    if waits := report.safety.waits_for_obstacles:
        lines.append(f"waited {waits} times for a person or thing in the way")
    if weeds.mapped is not None:
        lines += _format_weeds(weeds, report.implement.verb if report.implement else "treated")
    lines.append(
        f"{_format_number(spent.sim_s, unit=' s')} of the robot's time in "
        f"{_format_number(spent.wall_s, unit=' s')}, "
        f"{_format_number(spent.rtf_cpu)} x real time per CPU second"
    )
    if (out_dir / "report.html").exists():
        lines.append(f"{out_dir}/report.html")
    return "\n  ".join(lines) + "\n"


def _format_drive(mission: MissionReport, tracking: TrackingReport) -> str:
    """Format way, rows and crop; less of it on a real robot, whose truth is unknown."""
    parts = []
    if mission.distance_m is not None:
        parts.append(f"{_format_number(mission.distance_m, unit=' m')} driven")
    if mission.rows_total is not None:
        parts.append(f"rows {mission.rows_done}/{mission.rows_total}")
        parts.append(f"cross-track p95 {_format_number(tracking.xte_p95_m, 100, ' cm')}")
    if tracking.plants_crushed is not None:
        parts.append(f"plants crushed {tracking.plants_crushed}/{tracking.plants_total}")
    if tracking.plants_brushed:
        parts.append(f"{tracking.plants_brushed} brushed")
    return ", ".join(parts)


def _format_weeds(weeds: WeedReport, verb: str) -> list[str]:
    """Format what was mapped and treated, held against the true plants where they are known."""
    line = f"weeds mapped along the rows {weeds.mapped}"
    if weeds.truth is not None:
        line += f", true ones {weeds.truth}: precision {_format_number(weeds.precision)}"
        line += f", recall {_format_number(weeds.recall)}"
    lines = [f"{line}, treated {weeds.treated}", *_format_crops(weeds)]
    if weeds.treated_true is not None:
        hit = _format_number(weeds.crops_hit)
        lines.append(f"{_format_number(weeds.treated_true)} weeds {verb}, {hit} crops hit")
    if weeds.in_row is not None and weeds.between_rows is not None:
        shares = (f"in the row {_format_share(weeds.in_row)}",
                  f"between the rows {_format_share(weeds.between_rows)}")  # fmt: skip
        lines.append(f"weeds treated {', '.join(shares)}")
    for what, left in (("mapped weeds left", weeds.left), ("weeds untreated", weeds.untreated)):
        if left:
            reasons = ", ".join(f"{count} {reason}" for reason, count in left.items())
            lines.append(f"{what} {sum(left.values())}: {reasons}")
    return lines


def _format_share(part: TreatedShare) -> str:
    return f"{part.treated} of {part.of}"


def _format_crops(weeds: WeedReport) -> list[str]:
    if weeds.crops_mapped is None:
        return []
    line = f"crops mapped along the rows {weeds.crops_mapped}"
    if weeds.crops_truth is not None:
        line += (
            f", true ones {weeds.crops_truth}: recall {_format_number(weeds.crop_recall)}, "
            f"stems p95 {_format_number(weeds.stem_error_p95_m, 100, ' cm')}"
        )
    return [line]


def _format_number(value: float | None, scale: float = 1.0, unit: str = "") -> str:
    return "-" if value is None else f"{value * scale:.3g}{unit}"
