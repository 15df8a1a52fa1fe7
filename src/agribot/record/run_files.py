"""The files of a run's folder that are written at its end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from agribot.core import extras
from agribot.core.config import to_toml
from agribot.core.errors import RecordingError
from agribot.record.report import Report, write_file, write_report
from agribot.record.series import RunData
from agribot.record.weeds import write_weeds

# What a robot without the extra says at the end of a run.
NO_FIGURES = (
    "report.html and map.png are left out, for nothing here draws figures: "
    f"{extras.format_install('report')}, then agribot report run.mcap -o DIR"
)


def write_run_files(folder: Path, report: Report, data: RunData) -> str:
    """Write report.json, report.html, map.png, weeds.geojson and config.toml.

    Those that can be written are, whatever becomes of the others. Returns what is left out because
    its packages are not installed, in words; empty where nothing is.

    Raises: RecordingError: one of them cannot be written; the first that failed.
    """
    failures: list[RecordingError] = []
    draws = extras.has("report")
    writers: list[Callable[[], None]] = [
        lambda: write_report(folder / "report.json", report),
        lambda: write_file(folder / "config.toml", to_toml(data.config).encode()),
        lambda: write_weeds(folder / "weeds.geojson", data.plants, data.config.field.datum),
    ]
    if draws:
        writers += [lambda: _draw_page(folder, report, data), lambda: _draw_map(folder, data)]
    for write in writers:
        try:
            write()
        except RecordingError as error:
            failures.append(error)
    if failures:
        raise failures[0]
    return "" if draws else NO_FIGURES


def _draw_page(folder: Path, report: Report, data: RunData) -> None:
    from agribot.record.page import write_page

    write_page(folder / "report.html", report, data)


def _draw_map(folder: Path, data: RunData) -> None:
    from agribot.record.drawing import encode_png
    from agribot.record.map_figure import draw_map

    write_file(folder / "map.png", encode_png(draw_map(data)))
