"""Figures of a weed map: weeds per square metre, what was treated, and the stand of the crop."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator

from agribot.autonomy.weeds.plant_table import DECISIONS, OUTCOMES, PlantTable, Rows, is_crop
from agribot.core.messages import FloatArray, Row
from agribot.core.row_shape import row_points_map_m
from agribot.gis.weeds.styles import STYLES
from agribot.record.crop_stand import RowStand
from agribot.record.drawing import CROP_MARKER, GREEN, GREY, INK, ORANGE, WEED_MARKER, new_figure
from agribot.record.map_figure import add_scale_bar

_MOST_CELLS = 120  # cells along the longer side
_LEAST_CELL_M = 0.1
_BLUR_M = 0.5  # 1 sigma of the circle in which weeds are counted, at least two cells
_MARGIN_M = 0.8
_LOOK_M = 0.75  # beside the way: ground that the camera showed
_MOST_DOTS = 20_000
_BAR_IN = 0.15
# Half a page: the axes at most this large, and around them room for labels, title and legend.
_WIDTH_IN, _HEIGHT_IN = 4.5, 6.0
_LEFT_IN, _RIGHT_IN, _BELOW_IN, _TITLE_IN, _LEGEND_IN = 0.7, 0.2, 1.35, 0.65, 0.72
_LEAST_ASPECT = 0.3
Extent = tuple[float, float, float, float]  # x_min, x_max, y_min, y_max of a map
LegendPlace = tuple[float, float]


def draw_density(
    table: PlantTable, rows: Sequence[Row] = (), way_m: FloatArray | None = None
) -> Figure:
    """Draw weeds per square metre; ground beside which the robot did not drive stays blank.

    `way_m` (N, 2) is where the robot drove; without it, ground near plants counts as looked at.
    """
    extent = _find_extent_m(table, rows, way_m)
    cell_m = _choose_cell_m(extent)
    density, edges = count_density(table, extent, cell_m, way_m)
    figure, axes, legend_at = _begin_map(extent, rows)
    most = float(np.nanquantile(density, 0.995)) if np.isfinite(density).any() else 0.0
    most = max(most, 0.5)
    image = axes.imshow(
        np.ma.masked_invalid(density), origin="lower", extent=edges, cmap="YlOrRd", vmin=0.0,
        vmax=most, interpolation="nearest", zorder=2,
    )  # fmt: skip
    axes.set(xlim=extent[:2], ylim=extent[2:])
    _add_colour_bar(figure, image, legend_at)
    weeds = int((~is_crop(table.rows)).sum())
    looked_m2 = float(np.isfinite(density).sum()) * cell_m**2
    mean = weeds / looked_m2 if looked_m2 else 0.0
    _title(
        figure,
        legend_at[0],
        "Weeds per m²",
        f"{weeds} weeds, {mean:.1f} per m² on {looked_m2:.0f} m² seen",
    )
    return figure


def count_density(
    table: PlantTable,
    extent: Extent,
    cell_m: float,
    way_m: FloatArray | None = None,
) -> tuple[FloatArray, Extent]:
    """Count weeds per square metre of the ground seen around each cell (rows, columns).

    Weeds and ground count with a Gaussian weight; cells that were not seen are NaN. Returns the
    density and the edges of the cells: x_min, x_max, y_min, y_max.
    """
    x_min, x_max, y_min, y_max = extent
    columns, lines = math.ceil((x_max - x_min) / cell_m), math.ceil((y_max - y_min) / cell_m)
    low = np.array([x_min, y_min])
    weeds_m = table.xy_m[~is_crop(table.rows)]
    counts = np.zeros((lines, columns))
    looked = np.zeros((lines, columns), dtype=bool)
    column, line = np.floor((weeds_m - low) / cell_m).astype(int).T
    np.add.at(counts, (line.clip(0, lines - 1), column.clip(0, columns - 1)), 1.0)
    seen_m = table.xy_m if way_m is None or not len(way_m) else np.vstack([way_m, table.xy_m])
    reach = math.ceil(_LOOK_M / cell_m)
    home = np.unique(np.floor((seen_m - low) / cell_m).astype(int), axis=0)
    for across in range(-reach, reach + 1):
        for along in range(-reach, reach + 1):
            if math.hypot(across, along) * cell_m > _LOOK_M + cell_m / 2.0:
                continue
            near = home + np.array([across, along])
            near = near[((near >= 0) & (near < (columns, lines))).all(axis=1)]
            looked[near[:, 1], near[:, 0]] = True
    looked |= counts > 0
    weights = _make_weights(cell_m)
    area_m2 = _blur(looked.astype(float), weights) * cell_m**2
    with np.errstate(invalid="ignore", divide="ignore"):
        density = np.where(looked, _blur(counts, weights) / area_m2, np.nan)
    return density, (x_min, x_min + columns * cell_m, y_min, y_min + lines * cell_m)


def _make_weights(cell_m: float) -> FloatArray:
    sigma = max(_BLUR_M / cell_m, 2.0)  # in cells
    offset = np.arange(-math.ceil(3.0 * sigma), math.ceil(3.0 * sigma) + 1)
    weights: FloatArray = np.exp(-0.5 * (offset / sigma) ** 2)
    weights /= weights.sum()
    return weights


def _blur(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Blur both axes of (rows, columns) with symmetric weights."""
    half = len(weights) // 2
    for axis in (0, 1):
        padded = np.moveaxis(values, axis, 0)
        padded = np.pad(padded, ((half, half), (0, 0)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, len(weights), axis=0)
        values = np.moveaxis(windows @ weights, 0, axis)
    return values


def draw_treatment(
    table: PlantTable, rows: Sequence[Row] = (), way_m: FloatArray | None = None
) -> Figure:
    """Draw every plant in the colour of its decision and outcome."""
    extent = _find_extent_m(table, rows, way_m)
    figure, axes, legend_at = _begin_map(extent, rows)
    styles = find_styles(table.rows)
    size = float(np.clip(500.0 / math.sqrt(len(styles) + 1.0), 1.0, 36.0))
    for number, (name, colour) in enumerate(STYLES.items()):
        xy_m = table.xy_m[styles == number]
        if not len(xy_m):
            continue
        is_hollow = name in {"weed", "weed, missed"}
        shown = xy_m[:: max(1, len(xy_m) * len(STYLES) // _MOST_DOTS)]
        axes.scatter(
            shown[:, 0], shown[:, 1], s=size * (0.5 if name == "crop" else 1.0), linewidths=1.4,
            marker=CROP_MARKER if name.startswith("crop") else WEED_MARKER,
            facecolors="none" if is_hollow else colour, edgecolors=colour,
            label=f"{name} ({len(xy_m)})", zorder=4 if name == "crop" else 5,
        )  # fmt: skip
    axes.set(xlim=extent[:2], ylim=extent[2:])
    if axes.collections:
        figure.legend(
            *axes.get_legend_handles_labels(), loc="upper left", bbox_to_anchor=legend_at,
            ncols=2, frameon=False, fontsize=9.5, labelcolor=INK, borderaxespad=0.0,
            labelspacing=0.4, columnspacing=1.6, handletextpad=0.3,
        )  # fmt: skip
    counts = [
        int((styles == [*STYLES].index(name)).sum()) for name in ("weed, treated", "weed, missed")
    ]
    _title(
        figure, legend_at[0], "Treated and left", f"{counts[0]} weeds treated, {counts[1]} missed"
    )
    return figure


def find_styles(rows: Rows) -> np.ndarray:
    """Find the index of each plant's style, (N,), by the rule of `styles.find_style`."""
    names = [*STYLES]
    styles = np.full(len(rows), names.index("weed"))
    styles[rows["decision"] == DECISIONS.index("spare")] = names.index("weed, spared")
    for code, outcome in enumerate(OUTCOMES):
        if outcome:
            styles[rows["outcome"] == code] = names.index(f"weed, {outcome}")
    styles[is_crop(rows)] = names.index("crop")
    return styles


def draw_stand(stands: Sequence[RowStand]) -> Figure:
    """Draw the rows one above the other: a dot for each plant, a bar for each gap."""
    height_in = 1.1 + 0.34 * max(len(stands), 2)
    figure, axes = new_figure(11.0, min(height_in, 14.0))
    for place, stand in enumerate(stands):
        if not stand.is_countable:
            axes.annotate(
                "leaves touch: not counted", (stand.length_m / 2, place), ha="center",
                va="center", fontsize=9, color=GREY,
            )  # fmt: skip
            continue
        axes.plot((0.0, stand.length_m), (place, place), color=GREY, alpha=0.35, linewidth=1.0)
        for begin_m, end_m in stand.gaps_m.clip(0.0, stand.length_m):
            axes.plot(
                (begin_m, end_m), (place, place), color=ORANGE, linewidth=6, alpha=0.55,
                solid_capstyle="butt", zorder=2,
            )  # fmt: skip
        axes.plot(
            stand.along_m, np.full(len(stand.along_m), place), "o", color=GREEN, markersize=4.5,
            zorder=3,
        )  # fmt: skip
    axes.set(
        yticks=range(len(stands)), yticklabels=[str(stand.row + 1) for stand in stands],
        ylim=(len(stands) - 0.4, -0.6), xlabel="Along the row (m)", ylabel="Row",
    )  # fmt: skip
    axes.grid(False, axis="y")
    longest_m = max((stand.length_m for stand in stands), default=1.0)
    axes.set_xlim(-0.01 * longest_m, 1.01 * longest_m)
    axes.plot([], [], "o", color=GREEN, markersize=4.5, label="crop plant")
    axes.plot([], [], color=ORANGE, linewidth=6, alpha=0.55, label="gap")
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False, fontsize=9,
        labelcolor=INK, borderaxespad=0.2,
    )  # fmt: skip
    return figure


def _begin_map(extent: Extent, rows: Sequence[Row]) -> tuple[Figure, Axes, LegendPlace]:
    """Lay a map out for half a page, with a legend below; last comes its upper left corner."""
    x_min, x_max, y_min, y_max = extent
    aspect = (y_max - y_min) / (x_max - x_min)
    height_in = min(_WIDTH_IN * aspect, _HEIGHT_IN)
    width_in = height_in / aspect
    whole_in = (_WIDTH_IN + _LEFT_IN + _RIGHT_IN, height_in + _BELOW_IN + _TITLE_IN)
    figure, axes = new_figure(*whole_in)
    figure.set_layout_engine("none")
    left_in = _LEFT_IN + (_WIDTH_IN - width_in) / 2.0
    axes.set_position(
        (left_in / whole_in[0], _BELOW_IN / whole_in[1], width_in / whole_in[0],
         height_in / whole_in[1])
    )  # fmt: skip
    for row in rows:
        axes.plot(*row_points_map_m(row).T, color=INK, alpha=0.35, linewidth=0.8, zorder=3)
    axes.set(
        aspect="equal", xlabel="East of the datum (m)", ylabel="North of the datum (m)",
        xlim=(x_min, x_max), ylim=(y_min, y_max),
    )  # fmt: skip
    add_scale_bar(axes, x_min, y_min, x_max - x_min)
    return figure, axes, (left_in / whole_in[0], _LEGEND_IN / whole_in[1])


def _title(figure: Figure, left: float, title: str, subtitle: str) -> None:
    height_in = figure.get_figheight()
    figure.text(left, 1.0 - 0.28 / height_in, title, fontsize=12, fontweight="bold", color=INK)
    figure.text(left, 1.0 - 0.5 / height_in, subtitle, fontsize=9.5, color=INK)


def _add_colour_bar(figure: Figure, image: AxesImage, at: LegendPlace) -> None:
    """Put the scale where a map has its legend."""
    width_in, height_in = figure.get_size_inches()
    box = (at[0], at[1] - _BAR_IN / height_in, 0.7 * _WIDTH_IN / width_in, _BAR_IN / height_in)
    bar = figure.colorbar(image, cax=figure.add_axes(box), orientation="horizontal", extend="max")
    bar.locator = MaxNLocator(nbins=5)
    bar.update_ticks()
    bar.outline.set_visible(False)
    bar.set_label("weeds per m²", color=INK)
    bar.ax.tick_params(colors=INK)


def _find_extent_m(table: PlantTable, rows: Sequence[Row], way_m: FloatArray | None) -> Extent:
    parts = [table.xy_m, *(row_points_map_m(row) for row in rows)]
    if way_m is not None:
        parts.append(way_m)
    everything = np.vstack(parts)
    if not len(everything):
        return -1.0, 1.0, -1.0, 1.0
    low, high = everything.min(axis=0) - _MARGIN_M, everything.max(axis=0) + _MARGIN_M
    flat_m = _LEAST_ASPECT * (high[0] - low[0]) - (high[1] - low[1])
    if flat_m > 0.0:  # a single row
        low[1], high[1] = low[1] - flat_m / 2.0, high[1] + flat_m / 2.0
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _choose_cell_m(extent: Extent) -> float:
    longer_m = max(extent[1] - extent[0], extent[3] - extent[2])
    return max(longer_m / _MOST_CELLS, _LEAST_CELL_M)
