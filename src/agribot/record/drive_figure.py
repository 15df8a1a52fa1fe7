"""Figure and table of a drive to a goal, from its topics: heading, distance, speed."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agribot.record.drawing import BLUE, GREEN, GREY, ORANGE, encode_png
from agribot.record.report import write_file

Samples = Sequence[tuple[float, float]]

_PANELS = (
    ("Heading (°)", (("heading_raw_deg", GREY, "raw"), ("heading_filtered_deg", BLUE, "filtered"))),
    ("Heading error (°)", (("heading_error_deg", ORANGE, "goal's bearing minus heading"),)),
    ("Distance (m)", (("distance_m", GREEN, "to the goal"),)),
    ("Command", (("v_mps", BLUE, "m/s"), ("yaw_rate_radps", ORANGE, "rad/s"))),
)


def write_drive_files(out_dir: Path, series: Mapping[str, Samples]) -> tuple[Path, Path]:
    """Write `drive.png` and `drive.csv` (name, t_s, value).

    Raises: RecordingError: they cannot be written.
    """
    picture, table = out_dir / "drive.png", out_dir / "drive.csv"
    write_file(picture, encode_png(draw_drive(series)))
    write_file(table, _format_csv(series).encode())
    return picture, table


def draw_drive(series: Mapping[str, Samples]) -> Figure:
    """Draw four panels over time; headings are dots, as a line would cross the seam at North."""
    figure = Figure(figsize=(11.0, 9.0), layout="constrained")
    all_axes = figure.subplots(len(_PANELS), 1, sharex=True)
    for axes, (label, lines) in zip(all_axes, _PANELS, strict=True):
        axes.set_ylabel(label)
        axes.grid(visible=True, alpha=0.3)
        for name, colour, legend in lines:
            _draw_samples(
                axes, series.get(name, ()), colour, legend, dots=name.startswith("heading")
            )
        if axes.has_data():
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
    all_axes[-1].set_xlabel("Time (s)")
    return figure


def _draw_samples(axes: Axes, samples: Samples, colour: str, legend: str, *, dots: bool) -> None:
    if not samples:
        return
    t_s, value = np.array(samples).T
    style = {"marker": ".", "markersize": 2.5, "linestyle": "none"} if dots else {"linewidth": 1.3}
    axes.plot(t_s, value, color=colour, label=legend, **style)


def _format_csv(series: Mapping[str, Samples]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("name", "t_s", "value"))
    for name, samples in series.items():
        writer.writerows((name, f"{t_s:.3f}", repr(value)) for t_s, value in samples)
    return text.getvalue()
