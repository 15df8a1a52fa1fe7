"""The files of a run's folder that are written at its end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from agribot.core.config import to_toml
from agribot.core.errors import RecordingError
from agribot.record.report import Report, write_file, write_report
from agribot.record.run_figures import write_map, write_page
from agribot.record.series import RunData
from agribot.record.weeds import WEED_FILE, write_weeds

DRAWN_FILE = "field.geojson"


def write_run_files(
    folder: Path, report: Report, data: RunData, may_draw: Callable[[], bool] | None = None
) -> None:
    """Write report.json, report.html, map.png, weeds.geojson, config.toml, and drawn rows.

    Those that can be written are, whatever becomes of the others. `may_draw` is asked before each
    of the two that take seconds, report.html and map.png.
    Raises: RecordingError: one of them cannot be written; the first that failed.
    """
    failures: list[RecordingError] = []
    first = Path(report.job.runs[0].folder) if report.job else folder
    map_name = first.resolve().name
    writers: tuple[Callable[[], None], ...] = (
        lambda: write_report(folder / "report.json", report),
        lambda: write_file(folder / "config.toml", to_toml(data.config).encode()),
        lambda: write_weeds(folder / WEED_FILE, data, map_name),
        lambda: _write_drawn(folder / DRAWN_FILE, data.drawn_field),
    )
    figures: tuple[Callable[[], None], ...] = (
        lambda: write_page(folder / "report.html", report, data),
        lambda: write_map(folder / "map.png", data),
    )
    for write in (*writers, *figures):
        if write in figures and may_draw is not None and not may_draw():
            continue
        try:
            write()
        except RecordingError as error:
            failures.append(error)
    if failures:
        raise failures[0]


def _write_drawn(path: Path, text: str) -> None:
    if text:
        write_file(path, text.encode())
