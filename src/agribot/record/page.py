"""report.html: one file, nothing loaded from anywhere, light and dark."""

from __future__ import annotations

import math
from html import escape
from importlib import resources
from pathlib import Path

from agribot.core.config import to_toml
from agribot.core.messages import MappedPlant, PlantClass
from agribot.record import plots
from agribot.record.drawing import encode_svg
from agribot.record.html_tables import fold_table, format_number, render_table
from agribot.record.map_figure import draw_map
from agribot.record.report import Report, write_file
from agribot.record.row_table import RowSummary, summarise_rows
from agribot.record.series import RunData
from agribot.record.tiles import make_tiles
from agribot.record.weed_page import render_run_weeds


def write_page(path: Path, report: Report, data: RunData) -> None:
    """Write report.html.

    Raises: RecordingError: the file cannot be written.
    """
    write_file(path, render_report(report, data).encode())


def render_report(report: Report, data: RunData) -> str:
    css = resources.files("agribot.record").joinpath("report.css").read_text("utf-8")
    title = f"AGRIBOT run: {report.profile}"
    parts = [
        _render_header(report),
        f'<dl class="tiles">{"".join(_render_tile(*tile) for tile in make_tiles(report))}</dl>',
        _render_beliefs(report),
        f"<h2>Map</h2>\n<div class='card map'>{encode_svg(draw_map(data), 'Map of the run')}</div>",
        _render_rows(data),
        _render_plots(data),
        _render_left(report),
        render_run_weeds(data),
        _render_weeds(data.plants),
        _render_events(data),
        _render_conditions(report),
        _render_settings(data),
        _render_footer(report),
    ]
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{css}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _render_header(report: Report) -> str:
    verdict = "Done" if report.ok else "Not good"
    preset = "" if report.preset is None else f"preset {escape(report.preset)}, "
    return (
        f'<header><p class="eyebrow">AGRIBOT run report, sensors {escape(report.sensors)}, {preset}'
        f"seed {report.seed}</p>\n<h1>{escape(report.profile)}</h1>\n"
        f'<div class="verdict{" ok" if report.ok else ""}"><strong>{verdict}</strong> '
        f"<span>{escape(report.reason)}</span></div>{_render_runs(report)}</header>"
    )


def _render_runs(report: Report) -> str:
    """Render the table of a job in several runs; the page's clock is that of the first."""
    if report.job is None:
        return ""
    runs = ", ".join(f"{escape(run.folder)} ({run.run_s:.1f} s)" for run in report.job.runs)
    return f'<p class="none">One job in {len(report.job.runs)} runs: {runs}.</p>'


def _render_footer(report: Report) -> str:
    where = "The recording run.mcap in the same folder holds"
    if report.job is not None:
        where = "The recordings run.mcap in the folders of its runs hold"
    return f"<footer>AGRIBOT {escape(report.version)}. {where} everything shown here.</footer>"


def _render_tile(name: str, value: str, note: str) -> str:
    small = f"<small>{escape(note)}</small>" if note else ""
    return f'<div class="tile"><dt>{escape(name)}</dt><dd>{escape(value)}</dd>{small}</div>'


def _render_beliefs(report: Report) -> str:
    """Render what the robot believes beside what is known: the two differ where it errs."""
    if not report.beliefs:
        return ""
    heads = ("", "The robot believes", "Known")
    body = [
        [one.what, _format_belief(one.believed, one.unit), _format_belief(one.known, one.unit)]
        for one in report.beliefs
    ]
    return "<h2>Believed and known</h2>\n" + render_table(heads, body)


def _format_belief(value: float | None, unit: str) -> str:
    if value is None:
        return "–"
    if unit == "m" and abs(value) < 1.0:
        return f"{100.0 * value:.1f} cm"
    if unit == "rad":
        return f"{math.degrees(value):.2f}°"
    return f"{value:.4g}{' ' * bool(unit)}{unit}"


def _render_left(report: Report) -> str:
    """Render why weeds were left: those that truly stand there, and those of the map."""
    true, mapped = report.weeds.untreated or {}, report.weeds.left or {}
    if not true and not mapped:
        return ""
    body = [
        [reason, str(true.get(reason, 0)), str(mapped.get(reason, 0))]
        for reason in dict.fromkeys((*true, *mapped))
    ]
    heads = ("Reason", "True weeds of all rows", "Weeds on the map")
    return "<h2>Why weeds were left</h2>\n" + render_table(heads, body)


def _render_rows(data: RunData) -> str:
    if not data.rows:
        return ""
    heads = (
        "Row", "Driven (m)", "Crop seen (m)", "Time (s)", "Mean speed (m/s)",
        "Cross-track rms (cm)", "Cross-track max (cm)", "Weeds mapped", "Weeds treated",
    )  # fmt: skip
    body = [_format_row(summary) for summary in summarise_rows(data)]
    return "<h2>Rows</h2>\n" + render_table(heads, body)


def _format_row(row: RowSummary) -> list[str]:
    return [
        str(row.index + 1),
        f"{row.distance_m:.1f}",
        format_number(row.seen_m, 1),
        f"{row.duration_s:.1f}",
        format_number(row.speed_mps, 2),
        format_number(row.cross_track_rms_m, 1, 100.0),
        format_number(row.cross_track_max_m, 1, 100.0),
        str(row.weeds_mapped),
        str(row.weeds_treated),
    ]


def _render_plots(data: RunData) -> str:
    figures = (
        ("Cross-track", plots.draw_cross_track, True),
        ("Heading", plots.draw_heading, False),
        ("Speed", plots.draw_speed, False),
        ("Position", plots.draw_position, False),
        ("Weeds", plots.draw_weeds, False),
    )
    cards = [
        f'<div class="card{" wide" if wide else ""}"><h3>{name}</h3>'
        f"{encode_svg(draw(data), f'{name} plot')}</div>"
        for name, draw, wide in figures
    ]
    return f'<h2>Plots</h2>\n<div class="plots">{"".join(cards)}</div>'


def _render_weeds(plants: tuple[MappedPlant, ...]) -> str:
    weeds = [plant for plant in plants if plant.plant == PlantClass.WEED]
    if not weeds:
        return '<h2>Weeds</h2>\n<p class="none">No weed was mapped.</p>'
    heads = (
        "Weed", "East (m)", "North (m)", "1 sigma (cm)", "Area (cm²)", "Confidence", "Sightings",
        "Treated at (s)",
    )  # fmt: skip
    body = [
        [
            str(weed.id),
            f"{weed.x_map_m:.2f}",
            f"{weed.y_map_m:.2f}",
            f"{100 * weed.std_m:.1f}",
            f"{1e4 * weed.area_m2:.0f}",
            f"{weed.confidence:.2f}",
            str(weed.sightings),
            format_number(weed.treated_s, 1),
        ]
        for weed in weeds
    ]
    return "<h2>Weeds</h2>\n" + fold_table(
        f"{len(weeds)} weeds on the map", render_table(heads, body), body
    )


def _render_events(data: RunData) -> str:
    if not data.events:
        return '<h2>Events</h2>\n<p class="none">None.</p>'
    rows = [
        f'<tr><td class="left">{event.t_s:.2f}</td>'
        f'<td class="left"><span class="kind {event.kind}">{event.kind}</span></td>'
        f'<td class="left wrap">{escape(event.reason)}</td></tr>'
        for event in data.events
    ]
    table = (
        '<div class="card scroll"><table><thead><tr><th class="left">Time (s)</th>'
        '<th class="left">Kind</th><th class="left" style="width:100%">What</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )
    return "<h2>Events</h2>\n" + fold_table(f"{len(rows)} events", table, rows)


def _render_conditions(report: Report) -> str:
    """Render what the seed drew of the simulated world, which the robot does not know."""
    if report.conditions is None:
        return ""
    body = [[name.replace("_", " "), _format_drawn(v)] for name, v in report.conditions.items()]
    heads = ("What the robot does not know", "Drawn")
    return "<h2>Conditions</h2>\n" + render_table(heads, body)


def _format_drawn(value: object) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_format_drawn, value)) or "none"
    if value is None:
        return "as the world says"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _render_settings(data: RunData) -> str:
    toml = escape(to_toml(data.config))
    return (
        "<h2>Settings</h2>\n<details><summary>All settings of the run, resolved</summary>"
        f'<div class="card" style="padding:0"><pre>{toml}</pre></div></details>'
    )
