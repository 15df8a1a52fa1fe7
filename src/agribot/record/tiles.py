"""The summary tiles of the report page: the numbers that a farmer or a reviewer asks for first."""

from __future__ import annotations

from agribot.record.report import Report, WeedReport

Tile = tuple[str, str, str]  # name, value, note

NOTHING = "–"


def make_tiles(report: Report) -> list[Tile]:
    """Make the tiles that apply to the run; a value that was not measured shows a dash."""
    return [
        *_mission(report),
        *_tracking(report),
        *_weeds(report),
        *_implement(report),
        *_perception(report),
        _time(report),
    ]


def _mission(report: Report) -> list[Tile]:
    mission = report.mission
    result: list[Tile] = []
    if mission.rows_total:
        share = f"coverage {format_percent(mission.coverage_ratio)}"
        result.append(
            ("Rows done", f"{_format_count(mission.rows_done)} of {mission.rows_total}", share)
        )
    else:
        total = _format_count(mission.waypoints_total)
        reached = f"{_format_count(mission.waypoints_reached)} of {total}"
        result.append(("Waypoints reached", reached, ""))
    rate = format_number(mission.h_per_ha, 1, " h/ha")
    result.append(("Driven", format_number(mission.distance_m, 1, " m"), rate))
    each = format_number(report.safety.km_per_intervention, 2, " km each")
    count = len(report.safety.interventions)
    result.append(("Needed a person", f"{count} times", each if count else ""))
    return result


def _tracking(report: Report) -> list[Tile]:
    tracking, estimate = report.tracking, report.estimate
    if tracking.xte_p95_m is None and estimate.pos_rms_m is None:
        return []
    plants = f"of {_format_count(tracking.plants_total)} plants"
    by = tracking.plants_crushed_by
    counts = ("wheels", by.wheel), ("belly", by.belly), ("implement", by.implement)
    plants += "".join(f"; {count} by {what}" for what, count in counts if count)
    if tracking.plants_brushed:
        plants += f"; {tracking.plants_brushed} brushed"
    return [
        (
            "Cross-track, 95 %",
            format_number(tracking.xte_p95_m, 1, " cm", 100.0),
            f"true; largest {format_number(tracking.xte_max_m, 1, ' cm', 100.0)}",
        ),
        ("Crops crushed", _format_count(tracking.plants_crushed), plants),
        (
            "Position error, rms",
            format_number(estimate.pos_rms_m, 1, " cm", 100.0),
            f"true; NEES {format_number(estimate.nees_mean, 1)} (ideal 3)",
        ),
    ]


def _weeds(report: Report) -> list[Tile]:
    weeds = report.weeds
    if weeds.mapped is None:
        return []
    truth = f"of {weeds.truth} true ones" if weeds.truth is not None else ""
    implement = report.implement
    ratio = implement.worked_area_ratio if implement else weeds.spray_area_ratio
    worked = f"{format_percent(ratio)} {implement.verb if implement else 'treated'}"
    return [
        ("Weeds mapped along the rows", _format_count(weeds.mapped), truth),
        (
            "Precision / recall",
            f"{format_number(weeds.precision, 2)} / {format_number(weeds.recall, 2)}",
            f"median error {format_number(weeds.pos_error_median_m, 1, ' cm', 100.0)}",
        ),
        *_crops(weeds),
        (
            "Weeds treated",
            _format_count(weeds.treated),
            f"{_format_count(weeds.crops_hit)} crops hit, {worked}",
        ),
        *_split_by_rows(weeds),
        *_left(weeds),
    ]


def _split_by_rows(weeds: WeedReport) -> list[Tile]:
    """Make the tiles of the weeds in the rows and between them; none for an older report."""
    parts = ("in the row", weeds.in_row), ("between the rows", weeds.between_rows)
    return [
        (f"Weeds treated {where}", str(part.treated), f"of {part.of}, {format_percent(part.share)}")
        for where, part in parts
        if part is not None
    ]


def _left(weeds: WeedReport) -> list[Tile]:
    """Make the tile of the weeds that were left, and why; none where all were treated."""
    if not weeds.left:
        return []
    reasons = ", ".join(f"{count} {reason}" for reason, count in weeds.left.items())
    return [("Mapped weeds left", str(sum(weeds.left.values())), reasons)]


def _crops(weeds: WeedReport) -> list[Tile]:
    """Make the tile of the mapped crops; none for a report from before they were counted."""
    if weeds.crops_mapped is None:
        return []
    truth = f"of {weeds.crops_truth} true ones" if weeds.crops_truth is not None else ""
    if weeds.crop_recall is not None:
        error = format_number(weeds.stem_error_p95_m, 1, " cm", 100.0)
        truth += f", recall {format_number(weeds.crop_recall, 2)}; stems, 95 % within {error}"
    return [("Crops mapped along the rows", str(weeds.crops_mapped), truth)]


def _implement(report: Report) -> list[Tile]:
    """Make the tiles of the implement, under its own names."""
    implement = report.implement
    if implement is None:
        return []
    return [
        (
            f"{implement.kind}: {line.name}".capitalize(),
            f"{line.value:.4g}{' ' * bool(line.unit)}{line.unit}",
            "as the robot believes",
        )
        for line in implement.lines
    ]


def _perception(report: Report) -> list[Tile]:
    perception = report.perception
    if not perception.frames:
        return []
    mean = format_number(perception.miou, 2)
    iou = f"weed IoU {format_number(perception.iou.weed, 2)}, mean {mean}"
    return [("Frames seen", str(perception.frames), iou)]


def _time(report: Report) -> Tile:
    spent = report.time
    speed = f"{format_number(spent.rtf_cpu, 1)} x real time per CPU s"
    return ("Time in the field", _format_duration(spent.sim_s), speed if spent.rtf_cpu else "")


def format_number(value: float | None, decimals: int, unit: str = "", scale: float = 1.0) -> str:
    return NOTHING if value is None else f"{value * scale:.{decimals}f}{unit}"


def format_percent(ratio: float | None) -> str:
    return format_number(ratio, 0 if ratio is None or ratio >= 0.1 else 1, " %", 100.0)


def _format_count(value: int | None) -> str:
    return NOTHING if value is None else str(value)


def _format_duration(seconds: float | None) -> str:
    if seconds is None:
        return NOTHING
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
