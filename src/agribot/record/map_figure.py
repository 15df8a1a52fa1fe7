"""The map of a run: rows, plan, driven path, waypoints and the weed map."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from agribot.core.messages import FloatArray, PlantClass
from agribot.core.row_shape import row_points_map_m, start_yaw_rad
from agribot.record.drawing import (
    BLUE,
    CROP_MARKER,
    GREEN,
    GREY,
    INK,
    ORANGE,
    RED,
    WEED_MARKER,
    new_figure,
    sample_every,
)
from agribot.record.series import RunData

_MARGIN_M = 0.8
_LONGER_SIDE_IN = 11.0
_SHORTER_SIDE_MIN_IN = 4.5
_LEGEND_WIDTH_IN, _LEGEND_HEIGHT_IN = 2.3, 0.9  # beside a tall map, below a wide one
_LEFT_IN, _RIGHT_IN, _BELOW_IN, _TITLE_IN = 0.75, 0.25, 0.65, 0.85
_BAR_LENGTHS_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)


def draw_map(data: RunData) -> Figure:
    """Draw metres East and North of the field's datum, equal scales."""
    x_min, x_max, y_min, y_max = _find_extent_m(data)
    figure, axes, legend_at = _lay_out((y_max - y_min) / (x_max - x_min))
    _draw_field(axes, data)
    _draw_paths(axes, data)
    _draw_plants(axes, data)
    _draw_points(axes, data)
    axes.set(
        xlim=(x_min, x_max),
        ylim=(y_min, y_max),
        aspect="equal",
        xlabel="East of the datum (m)",
        ylabel="North of the datum (m)",
    )
    axes.set_title(data.config.profile, loc="left", fontsize=16, fontweight="bold", pad=26)
    axes.annotate(
        _subtitle(data), (0.0, 1.0), xytext=(0, 9), xycoords="axes fraction",
        textcoords="offset points", fontsize=11.5, color=INK,
    )  # fmt: skip
    add_scale_bar(axes, x_min, y_min, x_max - x_min)
    figure.legend(
        *axes.get_legend_handles_labels(), loc="upper left", bbox_to_anchor=legend_at,
        ncols=1 if legend_at[0] > 0.5 else 6, frameon=False, fontsize=12, labelcolor=INK,
        borderaxespad=0.0, columnspacing=1.6, labelspacing=0.8,
    )  # fmt: skip
    return figure


def _lay_out(aspect: float) -> tuple[Figure, Axes, tuple[float, float]]:
    """Lay out for a height-to-width ratio; last comes the legend's upper left corner."""
    is_tall = aspect > 1.0
    width_in = max(_LONGER_SIDE_IN / aspect, _SHORTER_SIDE_MIN_IN) if is_tall else _LONGER_SIDE_IN
    height_in = _LONGER_SIDE_IN if is_tall else max(_LONGER_SIDE_IN * aspect, _SHORTER_SIDE_MIN_IN)
    below_in = _BELOW_IN + (0.0 if is_tall else _LEGEND_HEIGHT_IN)
    full_width_in = _LEFT_IN + width_in + (_LEGEND_WIDTH_IN if is_tall else _RIGHT_IN)
    full_height_in = below_in + height_in + _TITLE_IN
    figure, axes = new_figure(full_width_in, full_height_in)
    figure.set_layout_engine("none")
    left, bottom = _LEFT_IN / full_width_in, below_in / full_height_in
    width, height = width_in / full_width_in, height_in / full_height_in
    axes.set_position((left, bottom, width, height))
    if is_tall:
        return figure, axes, (left + width + 0.25 / full_width_in, bottom + height)
    return figure, axes, (left, _LEGEND_HEIGHT_IN / full_height_in)


def _draw_field(axes: Axes, data: RunData) -> None:
    for row in data.rows:
        (x0, y0), yaw_rad = row.start_map_m, start_yaw_rad(row)
        label = "crop row" if row is data.rows[0] else None
        axes.plot(
            *row_points_map_m(row).T, color=GREY, alpha=0.25, linewidth=9,
            solid_capstyle="round", label=label, zorder=1,
        )  # fmt: skip
        ux, uy = math.cos(yaw_rad), math.sin(yaw_rad)
        beside = (x0 + 0.4 * ux - 0.25 * uy, y0 + 0.4 * uy + 0.25 * ux)
        axes.annotate(f"{row.index + 1}", beside, ha="center", va="center", color=GREY, fontsize=14)
    for number, (x_m, y_m, radius_m) in enumerate(data.config.field.obstacles_map_m):
        label = None if number else "obstacle"
        axes.add_patch(
            Circle((x_m, y_m), radius_m, facecolor=INK, edgecolor=INK, label=label, zorder=6)
        )
    for number, ring in enumerate(data.config.field.keep_out_map_m):
        label = None if number else "keep-out"
        axes.add_patch(
            Polygon(ring, facecolor=GREY, edgecolor=INK, alpha=0.4, label=label, zorder=2)
        )
    if data.world is not None:
        _draw_truth(axes, data)


def _draw_truth(axes: Axes, data: RunData) -> None:
    assert data.world is not None
    for kind, colour, marker, label in (
        (PlantClass.CROP, GREEN, CROP_MARKER, "true crop"),
        (PlantClass.WEED, RED, ".", "true weed"),
    ):
        places = [(p.x_map_m, p.y_map_m) for p in data.world.plants if p.plant == kind]
        if places:
            xy = np.array(places)
            axes.plot(
                xy[:, 0], xy[:, 1], marker, color=colour, alpha=0.45, markersize=4, label=label,
                zorder=2,
            )  # fmt: skip
    crushed = [data.world.plants[index] for index in data.crushed]
    if crushed:
        axes.plot(
            [p.x_map_m for p in crushed], [p.y_map_m for p in crushed], linestyle="none",
            marker="x", color=INK, markersize=9, markeredgewidth=2.4, label="crushed crop",
            zorder=8,
        )  # fmt: skip


def _draw_paths(axes: Axes, data: RunData) -> None:
    if data.plan is not None:
        plan = sample_every(data.plan.xy_map_m)
        axes.plot(plan[:, 0], plan[:, 1], color=GREY, linewidth=1.0, label="plan", zorder=3)
    series = data.series
    driven = sample_every(np.column_stack([series.x_map_m, series.y_map_m]), 4000)
    axes.plot(driven[:, 0], driven[:, 1], color=BLUE, linewidth=2.2, label="driven", zorder=4)
    if len(series.truth):
        truth = sample_every(series.truth, 4000)
        axes.plot(
            truth[:, 1], truth[:, 2], color=INK, linewidth=0.7, linestyle=(0, (3, 2)),
            label="truly driven", zorder=5,
        )  # fmt: skip


def _draw_plants(axes: Axes, data: RunData) -> None:
    crops = [p for p in data.plants if p.plant == PlantClass.CROP]
    weeds = [p for p in data.plants if p.plant == PlantClass.WEED]
    treated = [p for p in weeds if p.treated_s is not None]
    left = [p for p in weeds if p.treated_s is None]
    for plants, marker, size, colour, fill, label in (
        (crops, CROP_MARKER, 6.0, GREEN, GREEN, "mapped crop"),
        (left, WEED_MARKER, 8.0, RED, "none", "mapped weed"),
        (treated, WEED_MARKER, 8.0, RED, RED, "treated weed"),
    ):
        if plants:
            xy = np.array([(p.x_map_m, p.y_map_m) for p in plants])
            axes.plot(
                xy[:, 0], xy[:, 1], linestyle="none", marker=marker, markersize=size,
                markeredgecolor=colour, markerfacecolor=fill, markeredgewidth=1.6, label=label,
                zorder=7,
            )  # fmt: skip


def _draw_points(axes: Axes, data: RunData) -> None:
    if data.goals_map_m:
        goals = np.array(data.goals_map_m)
        axes.plot(
            goals[:, 0], goals[:, 1], linestyle="none", marker="o", markersize=12,
            markerfacecolor=GREEN, markeredgecolor="white", markeredgewidth=1.5,
            label="waypoint", zorder=6,
        )  # fmt: skip
    xy = _known(data)
    if len(xy):
        axes.plot(
            *xy[0], marker="o", markersize=13, markerfacecolor="white", markeredgecolor=BLUE,
            markeredgewidth=3, linestyle="none", label="start", zorder=8,
        )  # fmt: skip
    stops = _find_stops(data)
    if len(stops):
        axes.plot(
            stops[:, 0], stops[:, 1], linestyle="none", marker="X", markersize=11, color=ORANGE,
            markeredgecolor="white", label="stop or fault", zorder=9,
        )  # fmt: skip


def _find_stops(data: RunData) -> FloatArray:
    series = data.series
    times_s = [e.t_s for e in data.events if e.kind in {"stop", "fault"}]
    known = np.isfinite(series.x_map_m)
    if not times_s or not known.any():
        return np.empty((0, 2))
    index = np.searchsorted(series.t_s[known], times_s).clip(0, known.sum() - 1)
    return np.column_stack([series.x_map_m[known][index], series.y_map_m[known][index]])


def _known(data: RunData) -> FloatArray:
    xy = np.column_stack([data.series.x_map_m, data.series.y_map_m])
    return xy[np.isfinite(xy).all(axis=1)]


def _find_extent_m(data: RunData) -> tuple[float, float, float, float]:
    """Find x_min, x_max, y_min, y_max of all that is drawn, with a margin."""
    places = [point for row in data.rows for point in row_points_map_m(row).tolist()]
    places += [*data.goals_map_m, *((p.x_map_m, p.y_map_m) for p in data.plants)]
    places += [(x_m, y_m) for x_m, y_m, _ in data.config.field.obstacles_map_m]
    parts = [np.array(places, dtype=float).reshape(-1, 2), _known(data)]
    if data.plan is not None:
        parts.append(data.plan.xy_map_m)
    everything = np.vstack(parts)
    if not len(everything):
        return -1.0, 1.0, -1.0, 1.0
    low, high = everything.min(axis=0) - _MARGIN_M, everything.max(axis=0) + _MARGIN_M
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _subtitle(data: RunData) -> str:
    weeds = [p for p in data.plants if p.plant == PlantClass.WEED]
    treated = sum(p.treated_s is not None for p in weeds)
    metres = float(data.series.distance_m[-1]) if len(data.series.distance_m) else 0.0
    return f"{metres:.0f} m driven, {len(weeds)} weeds on the map, {treated} treated"


def add_scale_bar(axes: Axes, x_min: float, y_min: float, width_m: float) -> None:
    """Draw a bar of a round length at the lower left of a map."""
    length_m = max(b for b in _BAR_LENGTHS_M if b <= max(width_m / 5.0, _BAR_LENGTHS_M[0]))
    x_m, y_m = x_min + 0.03 * width_m, y_min + 0.025 * width_m
    axes.plot(
        (x_m, x_m + length_m), (y_m, y_m), color=INK, linewidth=4, solid_capstyle="butt", zorder=10
    )
    axes.annotate(
        f"{length_m:g} m", (x_m + length_m / 2, y_m), xytext=(0, 5), textcoords="offset points",
        ha="center", va="bottom", color=INK, fontsize=11, zorder=10,
    )  # fmt: skip
