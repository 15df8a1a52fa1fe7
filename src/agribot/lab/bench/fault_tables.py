"""The campaign of faults as text: its table, its sum, and its part of a page and of a CSV file."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from agribot.core.errors import ConfigError
from agribot.lab.bench.fault_rows import FaultRow
from agribot.lab.bench.faults import name_drive

HEADS = ("fault", "drive", "runs", "detected", "harmless", "after", "reaction", "rolled", "allowed",
         "named", "one of two", "crushed", "outside", "it said")  # fmt: skip
OPEN_HEADS = ("fault", "drive", "runs", "detected", "harmless", "after", "crushed")
MOST_SAID = 160
# The first column of a CSV file of campaigns: the name of the campaign.
CAMPAIGN = "campaign"
ALL_NOTICED = "Every fault was noticed in every run, and no plant was crushed.\n"


def format_table(rows: Sequence[FaultRow], heads: Sequence[str] = HEADS) -> str:
    """Format one line for each scenario; "-" where nothing was measured."""
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for row in rows:
        cells = dict(zip(HEADS, (_escape(cell) for cell in list_cells(row)), strict=True))
        if row.fault != "no fault":
            cells["fault"] = f"`{cells['fault']}`"
        lines.append(f"| {' | '.join(cells[head] for head in heads)} |")
    return "\n".join(lines) + "\n"


def _escape(cell: str) -> str:
    return cell.replace("|", "\\|")


def format_open(rows: Sequence[FaultRow]) -> str:
    """Format what a reader of a page has to know: faults not always noticed, plants crushed."""
    left = [row for row in rows if is_open(row)]
    return format_table(left, OPEN_HEADS) if left else ALL_NOTICED


def is_open(row: FaultRow) -> bool:
    return bool(row.crushed_after) or (row.injected > 0 and row.noticed < row.injected)


def list_cells(row: FaultRow) -> tuple[str, ...]:
    """List the cells of a scenario in the order of `HEADS`."""
    said = row.reason or "-"
    if row.ended_badly:
        said = f"{said}; {row.ended_badly} ended by: {row.why_ended}"
    return (
        row.fault,
        name_drive(row.profile, row.sensors, row.platform, has_camera=row.has_camera),
        str(row.runs),
        _format(row.detected_ratio, 100.0, " %", 0),
        _format(row.harmless / row.injected if row.injected else None, 100.0, " %", 0),
        _format(row.time_to_detect_s, 1.0, " s", 2),
        row.reaction,
        _format(row.stop_distance_m_max, 1.0, " m", 2),
        _describe_allowed(row),
        _format(row.named_ratio, 100.0, " %", 0),
        _format(row.one_of_two / row.injected if row.injected else None, 100.0, " %", 0),
        _describe_crushed(row),
        _format(row.outside_m_max, 1.0, " m", 1),
        said.replace("\n", " ")[:MOST_SAID],
    )


def _describe_allowed(row: FaultRow) -> str:
    if not row.stop_distance_m_max or row.stop_allowed_m is None:
        return "-"
    kept = f", not kept {row.stops_too_long} times" if row.stops_too_long else ""
    return f"{row.stop_allowed_m:.2f} m{kept}"


def _describe_crushed(row: FaultRow) -> str:
    """Describe how many plants were crushed, and at which stage."""
    if not row.crushed_after:
        return "-" if row.crushed_after is None else "0"
    parts = (
        (row.crushed_before_detection, "before noticed"),
        (row.crushed_after_detection, "until at rest"),
        (row.crushed_after_standstill, "after rest"),
        (row.crushed_by_fault, "set down on"),
    )
    causes = ", ".join(f"{count} {words}" for count, words in parts if count)
    return f"{row.crushed_after}: {causes}" if causes else str(row.crushed_after)


def _format(value: float | None, scale: float, unit: str, digits: int) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}{unit}"


def describe_result(result: Mapping[str, Any]) -> str:
    """Summarize a campaign in a paragraph."""
    without = (
        f"{result['missions_without_fault']} drives without a fault, "
        f"{result['km_without_fault']:.2f} km, saw {result['false_stops']} false stops."
    )
    if not result["faults"]:
        return without[0].upper() + without[1:] + "\n"
    return (
        f"Of {result['faults']} faults on {result['seeds']} seeds the robot noticed "
        f"{_format(result['detected_ratio'], 100.0, ' %', 0)} and named the part of "
        f"{_format(result['named_ratio'], 100.0, ' %', 0)}, as one of two of "
        f"{_format(result['one_of_two_ratio'], 100.0, ' %', 0)}. {result['harmless']} times the "
        "fault stayed unnoticed and without effect; of the others it noticed "
        f"{_format(result['harmful_detected_ratio'], 100.0, ' %', 0)}, named "
        f"{_format(result['harmful_named_ratio'], 100.0, ' %', 0)}, and "
        f"{_format(result['harmful_one_of_two_ratio'], 100.0, ' %', 0)} as one of two.\n"
        f"Crushed after a fault: {_format(result['crushed_ratio'], 100.0, ' %', 3)} of the plants, "
        f"{result['crushed_after_detectable']} of them after the robot had noticed or could have, "
        f"and {result['crushed_by_fault']} where hands set it down. Outside the field at most "
        f"{_format(result['outside_m_max'], 1.0, ' m', 2)}; {result['stops_too_long']} stops took "
        f"more than the drive promises; the {without}\n"
    )


def rewrite_block(page: str, name: str, block: str) -> str:
    """Put a block between the two marks of a page that bear its name.

    Raises: ConfigError: the page has no such marks.
    """
    begin, end = f"<!-- campaign: {name} -->\n", f"<!-- end of {name} -->"
    before, _, rest = page.partition(begin)
    _, mark, after = rest.partition(end)
    if not mark:
        raise ConfigError(
            f"the page has no lines '{begin.strip()}' and '{end}'; add them where the table goes"
        )
    return f"{before}{begin}\n{block.strip()}\n\n{end}{after}"


def rewrite_rows(text: str, name: str, rows: Sequence[FaultRow]) -> str:
    """Put the rows of a campaign into the CSV text of all campaigns, instead of its old ones."""
    _, *others = csv.reader(io.StringIO(text)) if text else ([],)
    target = io.StringIO()
    writer = csv.writer(target, lineterminator="\n")
    writer.writerow((CAMPAIGN, *HEADS))
    writer.writerows(cells for cells in others if cells[0] != name)
    writer.writerows((name, *list_cells(row)) for row in rows)
    return target.getvalue()
