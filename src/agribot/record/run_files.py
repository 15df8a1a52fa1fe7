"""The files of a run's folder that are written at its end."""

from __future__ import annotations

from pathlib import Path

from agribot.config import to_toml
from agribot.record.drawing import png
from agribot.record.map_figure import map_figure
from agribot.record.page import write_page
from agribot.record.report import Report, write_file, write_report
from agribot.record.series import RunData
from agribot.record.weeds import write_weeds


def write_run_files(folder: Path, report: Report, data: RunData) -> None:
    """report.json, report.html, map.png, weeds.geojson and config.toml.

    Raises: RecordingError: one of them cannot be written.
    """
    write_report(folder / "report.json", report)
    write_file(folder / "config.toml", to_toml(data.config).encode())
    write_weeds(folder / "weeds.geojson", data.plants, data.config.field.datum)
    write_file(folder / "map.png", png(map_figure(data)))
    write_page(folder / "report.html", report, data)
