"""The page of a log: one file with map, figures, outages, and what was not used and why."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path

from agribot.core.version import __version__
from agribot.record.drawing import encode_svg
from agribot.record.html_tables import format_number, render_table
from agribot.record.localization import page_figures
from agribot.record.localization.camera import CameraStudy, render_camera
from agribot.record.localization.result import LocalizationResult, LocalizationRun, LogFacts
from agribot.record.report import write_file

_TILES = (
    ("Began after", "started_after_s", 1, " s", "from the first message of the log"),
    ("Way until then", "started_after_m", 1, " m", "by the wheels"),
    ("Off the fixes", "rms_to_fixes_m", 2, " m", "RMS from 60 s on, fixes that were given"),
    ("Within 3 sigma", "within_3_sigma_ratio", 3, "", "of pose and receiver together"),
    ("Normalised innovation", "nis_mean", 2, "", "squared, mean; 2 if both sigmas are honest"),
)


def write_localization_page(
    path: Path,
    runs: Sequence[LocalizationRun],
    facts: LogFacts,
    camera: CameraStudy | None = None,
) -> None:
    """Write report.html of a log; `runs` are one or two passes of the filter.

    Raises: RecordingError: the file cannot be written.
    """
    write_file(path, render_page(runs, facts, camera).encode())


def render_page(
    runs: Sequence[LocalizationRun], facts: LogFacts, camera: CameraStudy | None = None
) -> str:
    css = resources.files("agribot.record").joinpath("report.css").read_text("utf-8")
    result = runs[0].result
    is_good = result.reason == "ok"
    verdict = "Localized" if result.started_after_s is not None else "Not localized"
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Poses of {escape(facts.name)}</title>\n<style>\n{css}</style>\n</head>\n"
        '<body>\n<main>\n<header><p class="eyebrow">AGRIBOT, poses from a log, '
        f"{runs[0].duration_s:.0f} s, {runs[0].driven_m:.0f} m driven</p>\n"
        f'<h1>{escape(facts.name)}</h1>\n<div class="verdict{" ok" if is_good else ""}">'
        f"<strong>{verdict}</strong> <span>{escape(result.reason)}</span></div></header>\n"
        f"{render_sections(runs, facts, camera)}\n<footer>AGRIBOT {escape(__version__)}. "
        "poses.csv, poses.tum and estimate.mcap in the same folder hold the poses.</footer>\n"
        "</main>\n</body>\n</html>\n"
    )


def render_sections(
    runs: Sequence[LocalizationRun], facts: LogFacts, camera: CameraStudy | None = None
) -> str:
    """Render all that the page shows below its head, for other pages as well."""
    figures = (
        ("Map", page_figures.draw_map(runs), "Map of fixes and poses", " map"),
        ("Fixes and estimate", page_figures.draw_offsets(runs), "Distance of fixes", ""),
        ("Innovations", page_figures.draw_innovations(runs), "Normalised innovations", ""),
    )
    cards = [
        f'<h2>{name}</h2>\n<div class="card{kind}">{encode_svg(figure, label)}</div>'
        for name, figure, label, kind in figures
    ]
    parts = [
        _render_tiles(runs[0].result), *cards, _render_comparison(runs), _render_outages(runs),
        "" if camera is None else render_camera(camera),
        _render_sources(facts), _render_unused(runs[0], facts), _render_assumed(facts),
    ]  # fmt: skip
    return "\n".join(part for part in parts if part)


def _render_tiles(result: LocalizationResult) -> str:
    tiles = "".join(
        f'<div class="tile"><dt>{name}</dt>'
        f"<dd>{format_number(getattr(result, key), decimals)}{unit}</dd><small>{note}</small></div>"
        for name, key, decimals, unit, note in _TILES
    )
    used = f"{result.used} of {result.fixes}"
    tile = f'<div class="tile"><dt>Fixes used</dt><dd>{used}</dd><small></small></div>'
    return f'<dl class="tiles">{tiles}{tile}</dl>'


def _render_comparison(runs: Sequence[LocalizationRun]) -> str:
    if len(runs) < 2:
        return ""
    before, after = runs[0].result, runs[1].result
    body = [
        [name, *(format_number(getattr(each, key), decimals) for each in (before, after))]
        for name, key, decimals, *_ in _TILES
    ]
    body.append(["Fixes used", str(before.used), str(after.used)])
    changes = ", ".join(runs[1].settings)
    heads = ("", "As it is", f"With {changes}")
    return "<h2>With other settings</h2>\n" + render_table(heads, body)


def _render_outages(runs: Sequence[LocalizationRun]) -> str:
    if not runs[0].result.outages:
        return ""
    heads = ("From (s)", "To (s)", "Driven (m)", "Error (m)", "1 sigma stated (m)")
    body = [
        [
            f"{outage.from_s:g}" + ("" if number == 0 else ", changed"), f"{outage.to_s:g}",
            format_number(outage.driven_m, 1), format_number(outage.error_m, 2),
            format_number(outage.sigma_m, 2),
        ]
        for number, run in enumerate(runs)
        for outage in run.result.outages
    ]  # fmt: skip
    about = (
        '<p class="none">The fixes of an outage were withheld. Its error is the mean distance of '
        "those of its last 3 s from the estimate.</p>"
    )
    return "<h2>Outages</h2>\n" + render_table(heads, body) + about


def _render_sources(facts: LogFacts) -> str:
    heads = ("Sensor", "Source", "Kind", "Messages", "Measurements", "From (s)", "To (s)")
    body = [
        [
            each.sensor, each.source, each.kind, str(each.messages), str(each.measurements),
            f"{each.from_s:.1f}", f"{each.to_s:.1f}",
        ]
        for each in facts.sources
    ]  # fmt: skip
    return "<h2>What was read</h2>\n" + render_table(heads, body)


def _render_unused(run: LocalizationRun, facts: LogFacts) -> str:
    """Render what did not enter the filter, by its cause."""
    body = [[cause, str(count)] for cause, count in sorted(run.rejected.items())]
    table = render_table(("Left out by the filter", "Count"), body) if body else ""
    notes = "".join(f"<p>{escape(note)}.</p>" for note in facts.notes)
    stops = "".join(f"<li>from {t_s:.1f} s: {escape(why)}</li>" for t_s, why in run.stops)
    why = f"<h3>No good pose</h3>\n<ul>{stops}</ul>" if stops else ""
    nothing = "" if table or notes or why else '<p class="none">Everything was used.</p>'
    return "<h2>What was not used, and why</h2>\n" + notes + table + why + nothing


def _render_assumed(facts: LogFacts) -> str:
    lines = [f"IMU: the body's axes are {facts.mount}", *facts.robot]
    return "<h2>Mounting and robot</h2>\n" + "".join(f"<p>{escape(line)}.</p>" for line in lines)
