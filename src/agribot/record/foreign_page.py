"""The report of a foreign recording: plots of what it holds, and a list of what it lacks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from matplotlib.figure import Figure

from agribot.record.drawing import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    encode_png,
    new_figure,
    sample_every,
)
from agribot.record.foreign import ForeignData, PlotLine
from agribot.record.localization.page import describe_log
from agribot.record.localization.result import LocalizationRun, LogFacts
from agribot.record.report import write_file
from agribot.record.templates import fill_template

_COLOURS = (BLUE, ORANGE, GREEN, RED, GREY)


Localized = tuple[Sequence[LocalizationRun], LogFacts]


def write_foreign_report(
    folder: Path, recording: Path, data: ForeignData, localized: Localized | None = None
) -> dict[str, object]:
    """Write report.html, report.json, heading.png, distance.png, speed.png and track.png.

    A plot without data is not written; `localized` is what the filter made of the recording.
    Returns what report.json says.
    Raises: RecordingError: a file cannot be written.
    """
    figures = {
        "track": _draw_track(data.tracks),
        "heading": _draw_lines(data.heading_raw, data.heading_filtered, "Heading (°)"),
        "distance": _draw_lines((), data.distance, "Distance (m)"),
        "speed": _draw_lines((), data.speed, "Speed (m/s)"),
    }
    for name, figure in figures.items():
        if figure is not None:
            write_file(folder / f"{name}.png", encode_png(figure))
    summary = _summarise(recording, data)
    summary["localization"] = None if localized is None else localized[0][0].result
    text = msgspec.json.format(msgspec.json.encode(summary), indent=2)
    write_file(folder / "report.json", text + b"\n")
    page = fill_template(
        "record/foreign_page.html.j2", name=recording.name, data=data, figures=figures,
        log=describe_log(*localized) if localized else None,
    )  # fmt: skip
    write_file(folder / "report.html", page.encode())
    return summary


def _summarise(recording: Path, data: ForeignData) -> dict[str, object]:
    def sources(lines: tuple[PlotLine, ...]) -> dict[str, int]:
        return {line.label: len(line.points) for line in lines}

    return {
        "recording": recording.name,
        "messages": data.messages,
        "duration_s": data.duration_s,
        "heading_raw": sources(data.heading_raw),
        "heading_filtered": sources(data.heading_filtered),
        "distance": sources(data.distance),
        "speed": sources(data.speed),
        "track": sources(data.tracks),
        "missing": list(data.missing),
        "notes": list(data.notes),
        "damage": list(data.damage),
    }


def _draw_lines(
    dots: tuple[PlotLine, ...], lines: tuple[PlotLine, ...], ylabel: str
) -> Figure | None:
    if not dots and not lines:
        return None
    figure, axes = new_figure(11.0, 3.2)
    for line, colour in zip(dots, (GREY, RED, GREEN), strict=False):
        points = sample_every(line.points)
        axes.plot(
            points[:, 0], points[:, 1], ".", color=colour, markersize=3, label=f"{line.label}, raw"
        )
    for line, colour in zip(lines, _COLOURS, strict=False):
        points = sample_every(line.points)
        values = points[:, 1].copy()
        if dots or ylabel.startswith("Heading"):  # no stroke across where a heading passes North
            values[1:][np.abs(np.diff(points[:, 1])) > 180.0] = np.nan
        axes.plot(points[:, 0], values, color=colour, linewidth=1.3, label=line.label)
    axes.set(xlabel="Time (s)", ylabel=ylabel)
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False, fontsize=9,
        borderaxespad=0.2,
    )  # fmt: skip
    return figure


def _draw_track(lines: tuple[PlotLine, ...]) -> Figure | None:
    if not lines:
        return None
    figure, axes = new_figure(8.0, 6.5)
    for line, colour in zip(lines, _COLOURS, strict=False):
        points = sample_every(line.points, 4000)
        axes.plot(points[:, 0], points[:, 1], color=colour, linewidth=1.6, label=line.label)
        axes.plot(*points[0], "o", color=colour, markersize=8, markerfacecolor="white")
    axes.set(xlabel="x or East of the first fix (m)", ylabel="y or North of the first fix (m)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False, fontsize=9,
        borderaxespad=0.2,
    )  # fmt: skip
    return figure
