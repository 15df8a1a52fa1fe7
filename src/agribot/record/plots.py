"""The plots of the report: cross-track, heading, speed, uncertainty and weeds."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from agribot.core.messages import FloatArray, PlantClass, Row
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.record.drawing import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    RED,
    new_figure,
    sample_every,
    thin,
)
from agribot.record.series import RunData, RunSeries

_HEIGHT_IN = 2.9
_WIDE_IN, _HALF_IN = 11.0, 5.4  # as cards of the page, so that text is equally large


def draw_cross_track(data: RunData) -> Figure:
    """Draw the believed and the true error, left positive, over the driven distance."""
    figure, axes = _make_plot("Distance driven (m)", "Cross-track (cm)", _WIDE_IN)
    series = data.series
    x, y = thin(series.distance_m, 100.0 * series.cross_track_m)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.plot(x, y, color=BLUE, linewidth=1.3, label="as the robot believes, to its path")
    true_m = true_cross_track_m(series, data.rows)
    if np.isfinite(true_m).any():
        x, y = thin(series.distance_m, 100.0 * true_m)
        axes.plot(x, y, color=ORANGE, linewidth=1.3, label="truth, to the row line")
    _add_legend(axes)
    return figure


def draw_heading(data: RunData) -> Figure:
    """Draw degrees clockwise from North, as a compass."""
    figure, axes = _make_plot("Time (s)", "Heading (°)")
    series = data.series
    for samples, colour, label in (
        (series.raw_compass, GREY, "magnetometer, raw"),
        (series.course_compass, GREEN, "GNSS course"),
    ):
        if len(samples):
            picked = sample_every(samples, 700)
            axes.plot(picked[:, 0], picked[:, 1], ".", color=colour, markersize=2.5, label=label)
    lines = [(series.t_s, series.compass_deg, BLUE, "-", "estimate")]
    if len(series.truth):
        compass = (90.0 - np.degrees(series.truth[:, 3])) % 360.0
        lines.append((series.truth[:, 0], compass, INK, "--", "truth"))
    for t_s, compass, colour, style, label in lines:
        picked = sample_every(np.column_stack([t_s, compass]))
        axes.plot(
            picked[:, 0], _break_at_north(picked[:, 1]), style, color=colour,
            linewidth=1.5 if style == "-" else 0.8, label=label,
        )  # fmt: skip
    axes.set(ylim=(-5.0, 365.0), yticks=range(0, 361, 90))
    _add_legend(axes)
    return figure


def draw_speed(data: RunData) -> Figure:
    figure, axes = _make_plot("Time (s)", "Speed (m/s)")
    series = data.series
    axes.plot(*thin(series.t_s, series.commanded_mps), color=GREY, linewidth=1.2, label="commanded")
    axes.plot(*thin(series.t_s, series.speed_mps), color=BLUE, linewidth=1.2, label="estimate")
    _add_legend(axes)
    return figure


def draw_position(data: RunData) -> Figure:
    """Draw the estimate's own uncertainty and, where the truth is known, its error."""
    figure, axes = _make_plot("Time (s)", "Position error (cm)")
    series = data.series
    axes.plot(
        *thin(series.t_s, 100.0 * series.pos_std_m), color=BLUE, linewidth=1.5,
        label="1 sigma, as the robot believes",
    )  # fmt: skip
    if len(series.truth):
        error_m = np.hypot(
            series.x_map_m - _interpolate_truth(series, 1),
            series.y_map_m - _interpolate_truth(series, 2),
        )
        x, y = thin(series.t_s, 100.0 * error_m)
        axes.plot(x, y, color=ORANGE, linewidth=0.9, label="true error")
    axes.set_ylim(bottom=0.0)
    _add_legend(axes)
    return figure


def draw_weeds(data: RunData) -> Figure:
    figure, axes = _make_plot("Time (s)", "Weeds")
    weeds = [p for p in data.plants if p.plant == PlantClass.WEED]
    end_s = float(data.series.t_s[-1]) if len(data.series.t_s) else 0.0
    seen_s = sorted(p.first_seen_s for p in weeds)
    treated_s = sorted(p.treated_s for p in weeds if p.treated_s is not None)
    for times_s, colour, label in ((seen_s, RED, "first seen"), (treated_s, GREEN, "treated")):
        t_s = [0.0, *times_s, max([end_s, *times_s])]
        counts = [*range(len(times_s) + 1), len(times_s)]
        axes.step(t_s, counts, where="post", color=colour, linewidth=1.6, label=label)
    axes.set_ylim(bottom=0.0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    _add_legend(axes)
    return figure


def true_cross_track_m(series: RunSeries, rows: tuple[Row, ...]) -> FloatArray:
    """Compute how far left of the worked row the true position is, (N,); NaN elsewhere."""
    result = np.full(len(series.t_s), np.nan)
    if not len(series.truth):
        return result
    x_m, y_m = _interpolate_truth(series, 1), _interpolate_truth(series, 2)
    facing = np.radians(90.0 - series.compass_deg)
    for row in rows:
        along_m, left_of_row_m, row_yaw_rad = project_on_row(row, x_m, y_m)
        inside = (along_m >= 0.0) & (along_m <= row_length_m(row))
        here = (series.row == row.index) & inside
        direction = np.sign(np.cos(facing - row_yaw_rad))
        result[here] = (direction * left_of_row_m)[here]
    return result


def _interpolate_truth(series: RunSeries, column: int) -> FloatArray:
    return np.interp(series.t_s, series.truth[:, 0], series.truth[:, column])


def _break_at_north(compass_deg: FloatArray) -> FloatArray:
    """Put NaN where a heading (N,) passes North, so that no line crosses the plot."""
    broken = compass_deg.copy()
    broken[1:][np.abs(np.diff(compass_deg)) > 180.0] = np.nan
    return broken


def _make_plot(xlabel: str, ylabel: str, width_in: float = _HALF_IN) -> tuple[Figure, Axes]:
    figure, axes = new_figure(width_in, _HEIGHT_IN)
    axes.set(xlabel=xlabel, ylabel=ylabel)
    axes.margins(x=0.01)
    return figure, axes


def _add_legend(axes: Axes) -> None:
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False, fontsize=9,
        labelcolor=INK, borderaxespad=0.2, columnspacing=1.2, handlelength=1.4,
    )  # fmt: skip
