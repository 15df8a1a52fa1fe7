"""report.html: one file, nothing loaded from anywhere, light and dark."""

from __future__ import annotations

from html import escape
from importlib import resources
from pathlib import Path

from agribot.core.config import to_toml
from agribot.core.messages import MappedPlant, PlantClass
from agribot.record import plots
from agribot.record.drawing import svg
from agribot.record.map_figure import map_figure
from agribot.record.report import Report, write_file
from agribot.record.row_table import RowSummary, row_summaries
from agribot.record.series import RunData
from agribot.record.tiles import tiles

_OPEN_ROWS = 12  # longer tables start folded


def write_page(path: Path, report: Report, data: RunData) -> None:
    """Raises: RecordingError: the file cannot be written."""
    write_file(path, report_page(report, data).encode())


def report_page(report: Report, data: RunData) -> str:
    css = resources.files("agribot.record").joinpath("report.css").read_text("utf-8")
    title = f"AGRIBOT run: {report.profile}"
    parts = [
        _header(report),
        f'<dl class="tiles">{"".join(_tile(*tile) for tile in tiles(report))}</dl>',
        f"<h2>Map</h2>\n<div class='card map'>{svg(map_figure(data), 'Map of the run')}</div>",
        _rows_section(data),
        _plots_section(data),
        _weeds_section(data.plants),
        _events_section(data),
        _settings_section(data),
        _footer(report),
    ]
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{css}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _header(report: Report) -> str:
    verdict = "Done" if report.ok else "Not good"
    return (
        f'<header><p class="eyebrow">AGRIBOT run report, sensors {escape(report.sensors)}, '
        f"seed {report.seed}</p>\n<h1>{escape(report.profile)}</h1>\n"
        f'<div class="verdict{" ok" if report.ok else ""}"><strong>{verdict}</strong> '
        f"<span>{escape(report.reason)}</span></div>{_runs(report)}</header>"
    )


def _runs(report: Report) -> str:
    """Of a job in several runs; the clock of the page is that of the first."""
    if report.job is None:
        return ""
    runs = ", ".join(f"{escape(run.folder)} ({run.run_s:.1f} s)" for run in report.job.runs)
    return f'<p class="none">One job in {len(report.job.runs)} runs: {runs}.</p>'


def _footer(report: Report) -> str:
    where = "The recording run.mcap in the same folder holds"
    if report.job is not None:
        where = "The recordings run.mcap in the folders of its runs hold"
    return f"<footer>AGRIBOT {escape(report.version)}. {where} everything shown here.</footer>"


def _tile(name: str, value: str, note: str) -> str:
    small = f"<small>{escape(note)}</small>" if note else ""
    return f'<div class="tile"><dt>{escape(name)}</dt><dd>{escape(value)}</dd>{small}</div>'


def _rows_section(data: RunData) -> str:
    if not data.rows:
        return ""
    heads = (
        "Row", "Driven (m)", "Crop seen (m)", "Time (s)", "Mean speed (m/s)",
        "Cross-track rms (cm)", "Cross-track max (cm)", "Weeds mapped", "Weeds treated",
    )  # fmt: skip
    body = [_row_cells(summary) for summary in row_summaries(data)]
    return "<h2>Rows</h2>\n" + _table(heads, body)


def _row_cells(row: RowSummary) -> list[str]:
    return [
        str(row.index + 1),
        f"{row.distance_m:.1f}",
        _number(row.seen_m, 1),
        f"{row.duration_s:.1f}",
        _number(row.speed_mps, 2),
        _number(row.cross_track_rms_m, 1, 100.0),
        _number(row.cross_track_max_m, 1, 100.0),
        str(row.weeds_mapped),
        str(row.weeds_treated),
    ]


def _plots_section(data: RunData) -> str:
    figures = (
        ("Cross-track", plots.cross_track_figure, True),
        ("Heading", plots.heading_figure, False),
        ("Speed", plots.speed_figure, False),
        ("Position", plots.position_figure, False),
        ("Weeds", plots.weeds_figure, False),
    )
    cards = [
        f'<div class="card{" wide" if wide else ""}"><h3>{name}</h3>'
        f"{svg(draw(data), f'{name} plot')}</div>"
        for name, draw, wide in figures
    ]
    return f'<h2>Plots</h2>\n<div class="plots">{"".join(cards)}</div>'


def _weeds_section(plants: tuple[MappedPlant, ...]) -> str:
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
            _number(weed.treated_s, 1),
        ]
        for weed in weeds
    ]
    return "<h2>Weeds</h2>\n" + _folded(f"{len(weeds)} weeds on the map", _table(heads, body), body)


def _events_section(data: RunData) -> str:
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
    return "<h2>Events</h2>\n" + _folded(f"{len(rows)} events", table, rows)


def _settings_section(data: RunData) -> str:
    toml = escape(to_toml(data.config))
    return (
        "<h2>Settings</h2>\n<details><summary>All settings of the run, resolved</summary>"
        f'<div class="card" style="padding:0"><pre>{toml}</pre></div></details>'
    )


def _table(heads: tuple[str, ...], body: list[list[str]]) -> str:
    head = "".join(
        f"<th{' class=left' if i == 0 else ''}>{escape(text)}</th>" for i, text in enumerate(heads)
    )
    lines = "".join(
        "<tr>"
        + "".join(
            f"<td{' class=left' if i == 0 else ''}>{escape(text)}</td>"
            for i, text in enumerate(cells)
        )
        + "</tr>"
        for cells in body
    )
    return (
        f'<div class="card scroll"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{lines}</tbody></table></div>"
    )


def _folded(summary: str, table: str, body: list[list[str]] | list[str]) -> str:
    is_open = " open" if len(body) <= _OPEN_ROWS else ""
    return f"<details{is_open}><summary>{escape(summary)}</summary>{table}</details>"


def _number(value: float | None, decimals: int, scale: float = 1.0) -> str:
    return "–" if value is None else f"{value * scale:.{decimals}f}"
