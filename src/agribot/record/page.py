"""report.html: one file, nothing loaded from anywhere, light and dark."""

from __future__ import annotations

import math
from pathlib import Path

from agribot.core.config import to_toml
from agribot.core.messages import PlantClass
from agribot.record import plots
from agribot.record.map_figure import draw_map
from agribot.record.report import Report, WeedReport, write_file
from agribot.record.row_table import summarise_rows
from agribot.record.series import RunData
from agribot.record.templates import fill_template
from agribot.record.tiles import make_tiles
from agribot.record.weed_page import draw_run_weeds


def write_page(path: Path, report: Report, data: RunData) -> None:
    """Write report.html.

    Raises: RecordingError: the file cannot be written.
    """
    write_file(path, render_report(report, data).encode())


def render_report(report: Report, data: RunData) -> str:
    figures = {
        "Cross-track": plots.draw_cross_track(data),
        "Heading": plots.draw_heading(data),
        "Speed": plots.draw_speed(data),
        "Position": plots.draw_position(data),
        "Weeds": plots.draw_weeds(data),
    }
    return fill_template(
        "record/page.html.j2", report=report, tiles=make_tiles(report), map=draw_map(data),
        rows=summarise_rows(data), plots=figures, left=_count_left(report.weeds),
        weed_map=draw_run_weeds(data), events=data.events, settings=to_toml(data.config),
        weeds=[plant for plant in data.plants if plant.plant == PlantClass.WEED],
        format_belief=_format_belief, format_drawn=_format_drawn,
    )  # fmt: skip


def _count_left(weeds: WeedReport) -> list[tuple[str, int, int]]:
    """Count why weeds were left: those that truly stand there, and those of the map."""
    true, mapped = weeds.untreated or {}, weeds.left or {}
    reasons = dict.fromkeys((*true, *mapped))
    return [(reason, true.get(reason, 0), mapped.get(reason, 0)) for reason in reasons]


def _format_belief(value: float | None, unit: str) -> str:
    if value is None:
        return "–"
    if unit == "m" and abs(value) < 1.0:
        return f"{100.0 * value:.1f} cm"
    if unit == "rad":
        return f"{math.degrees(value):.2f}°"
    return f"{value:.4g}{' ' * bool(unit)}{unit}"


def _format_drawn(value: object) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_format_drawn, value)) or "none"
    if value is None:
        return "as the world says"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
