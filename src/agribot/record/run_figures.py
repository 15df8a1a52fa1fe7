"""report.html and map.png of a run, where the packages that draw are installed."""

from __future__ import annotations

from pathlib import Path

from agribot.core import extras
from agribot.record.report import Report, write_file
from agribot.record.series import RunData

NO_FIGURES = (
    "report.html and map.png are left out, for nothing here draws figures: "
    f"{extras.format_install('report')}, then agribot report run.mcap -o DIR"
)
HURRIED = (
    "report.html and map.png are left out, for the run was to end at once; "
    "agribot report run.mcap -o DIR makes them"
)


def explain_absence() -> str:
    """Say what a robot without the extra leaves out; empty where everything is drawn."""
    return "" if extras.has("report") else NO_FIGURES


def write_page(path: Path, report: Report, data: RunData) -> None:
    """Write report.html, or nothing where nothing draws.

    Raises: RecordingError: the file cannot be written.
    """
    if extras.has("report"):
        from agribot.record import page

        page.write_page(path, report, data)


def write_map(path: Path, data: RunData) -> None:
    """Write map.png, or nothing where nothing draws.

    Raises: RecordingError: the file cannot be written.
    """
    if extras.has("report"):
        from agribot.record.drawing import encode_png
        from agribot.record.map_figure import draw_map

        write_file(path, encode_png(draw_map(data)))
