"""The crop row before the robot by all rows that a front camera sees, with its sigma.

Every comb of parallel rows has a likelihood by how it correlates with the plants of the picture.
The result is the mean of the likeliest one and those beside it; the distance of all others from it,
weighted by likelihood, is its sigma. Of its rows the nearest that bears plants is taken, where its
own plants stand.
Source: Barnard 1983 (vanishing points by accumulation).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.far_view import (
    CELLS,
    PLANTS,
    Comb,
    Compared,
    FarView,
    RowGrid,
)
from agribot.autonomy.perceive.own_row import find_own_row
from agribot.autonomy.perceive.picture_rows import measure_contrast
from agribot.autonomy.perceive.plant_cover import excess_green, level_green, measure_cover
from agribot.core.messages import ByteArray, FloatArray

# 1 sigma, before anything is seen: of the camera's tilt on rough ground, of the robot's heading in
# rows, of the spacing of rows over that of the field (its logarithm), of the bend of rows.
TILT_STD_RAD, YAW_STD_RAD = math.radians(3.0), math.radians(15.0)
SPACING_STD_RATIO, BEND_STD_PER_M = 0.1, 0.02
BENDS_PER_M = (-0.04, -0.02, 0.02, 0.04)
STEPS = 7, 7, 5  # tilts, directions and spacings about the likeliest, from one step to the next
PLACE_M = 1.4  # ahead of the body's origin, where lines of different combs are compared
NEAREST_M, FARTHEST_M = 0.6, 3.0  # ahead, where offset and heading are measured
# Largest 1 sigma of a line: beyond it neither the row nor its direction can be identified.
MOST_ACROSS_RATIO, MOST_YAW_STD_RAD = 0.2, math.radians(10.0)
LEAST_ACROSS_STD_M, LEAST_YAW_STD_RAD = 0.02, math.radians(1.2)
NO_GREEN = -1.0  # excess green of a picture whose colours are not known
LEAST_SAMPLES = 4  # pixels of a picture, each way, whose mean is the colour of a cell


class FarLine(NamedTuple):
    """A row through (x, y) of the body frame towards `yaw_rad`, with 1 sigma across and of yaw.

    At that place the two errors are independent. Rows are `spacing_m` apart; the camera was taken
    to look further down than described by `tilt_rad`.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    across_std_m: float
    yaw_std_rad: float
    spacing_m: float
    tilt_rad: float


def find_far_line(contrast: FloatArray, view: FarView) -> FarLine | None:
    """Find the row nearest to the robot's way in a contrast (CELLS, CELLS); None: too doubtful."""
    grid, compared = view.coarse, view.compare(contrast)
    weighed = _weigh(compared, grid, view)
    best = np.unravel_index(int(weighed.argmax()), weighed.shape)
    around = (_span(axis, int(k), n) for axis, k, n in zip(grid, best, STEPS, strict=True))
    comb = _refine(contrast, view, RowGrid(*around))
    row = find_own_row(contrast, view, comb, PLACE_M)
    line = _spread(comb._replace(left_m=row.left_m), grid, compared, weighed)
    line = line._replace(y_m=line.y_m + row.aside_m / math.cos(line.yaw_rad))
    is_sure = line.across_std_m <= MOST_ACROSS_RATIO * line.spacing_m
    return line if is_sure and line.yaw_std_rad <= MOST_YAW_STD_RAD else None


def measure_far_contrast(class_map: ClassMap, image_rgb: ByteArray | None) -> FloatArray:
    """Measure the contrast (CELLS, CELLS) of plants with their surroundings in a picture."""
    class_id = class_map.class_id
    if image_rgb is None:
        green = np.full(class_id.shape, NO_GREEN)
    else:
        green = level_green(_spread_cells(_measure_green(image_rgb), class_id.shape), class_id)
    return measure_contrast(measure_cover(green, class_id, class_map.confidence), CELLS)


def _measure_green(image_rgb: ByteArray) -> FloatArray:
    """Measure the excess of green of blocks of a picture (H, W, 3), finer than cells."""
    block = max(1, min(image_rgb.shape[:2]) // (CELLS * LEAST_SAMPLES))
    height, width = (size // block * block for size in image_rgb.shape[:2])
    blocks = image_rgb[:height, :width].reshape(height // block, block, width // block, block, 3)
    return excess_green(blocks.mean(axis=(1, 3)))


def _spread_cells(values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Spread (h, w) over pixels (H, W)."""
    rows, columns = (
        (np.arange(size) * old) // size for size, old in zip(shape, values.shape, strict=True)
    )
    spread: FloatArray = values[rows[:, None], columns]
    return spread


def _weigh(compared: Compared, grid: RowGrid, view: FarView, bend_per_m: float = 0.0) -> FloatArray:
    """Weigh combs by their log-likelihood and what is known before."""
    spacings = np.zeros(len(grid.spacings_m))
    if view.spacing_m is not None:
        spacings = np.log(grid.spacings_m / view.spacing_m) / SPACING_STD_RATIO
    off2 = (
        (grid.tilts_rad[:, None, None] / TILT_STD_RAD) ** 2
        + (grid.yaws_rad[:, None] / YAW_STD_RAD) ** 2
        + spacings**2
        + (bend_per_m / BEND_STD_PER_M) ** 2
    )
    weighed: FloatArray = 0.5 * (PLANTS * compared.score.clip(0.0).astype(np.float64) ** 2 - off2)
    return weighed


def _span(axis: FloatArray, k: int, count: int) -> FloatArray:
    """Split both steps beside a grid's value, from the one before to the one after."""
    return np.linspace(axis[max(k - 1, 0)], axis[min(k + 1, len(axis) - 1)], count)


def _refine(contrast: FloatArray, view: FarView, grid: RowGrid) -> Comb:
    """Find the comb between the steps of the coarse grid, straight or bent."""
    compared = view.compare_fine(contrast, grid)
    weighed = _weigh(compared, grid, view)
    likeliest = _take_best(compared, grid, weighed, 0.0)
    comb, most = _average(likeliest, compared, grid, weighed), float(weighed.max())
    at_tilt = RowGrid(np.array([likeliest.tilt_rad]), grid.yaws_rad[1:-1], grid.spacings_m)
    for bend_per_m in BENDS_PER_M:
        compared = view.compare_fine(contrast, at_tilt, bend_per_m)
        weighed = _weigh(compared, at_tilt, view, bend_per_m)
        if float(weighed.max()) > most:
            comb = _take_best(compared, at_tilt, weighed, bend_per_m)
            most = float(weighed.max())
    return comb


def _take_best(compared: Compared, grid: RowGrid, weighed: FloatArray, bend_per_m: float) -> Comb:
    """Take the likeliest comb of a grid."""
    k = np.unravel_index(int(weighed.argmax()), weighed.shape)
    tilt_rad, yaw_rad, spacing_m = (float(axis[i]) for axis, i in zip(grid, k, strict=True))
    return Comb(tilt_rad, yaw_rad, spacing_m, float(compared.left_m[k]), bend_per_m)


def _average(comb: Comb, compared: Compared, grid: RowGrid, weighed: FloatArray) -> Comb:
    """Average the combs of a grid with a line where `comb` has one, by their likelihood."""
    share = _share(weighed)
    yaws_rad = np.broadcast_to(grid.yaws_rad[:, None], share.shape)
    y_m = _find_nearest(comb)
    at_m = _find_line(y_m, yaws_rad, compared.left_m.astype(np.float64), grid.spacings_m)
    yaw_rad = float((share * yaws_rad).sum())
    return Comb(
        float((share * grid.tilts_rad[:, None, None]).sum()),
        yaw_rad,
        float((share * grid.spacings_m).sum()),
        math.cos(yaw_rad) * float((share * at_m).sum()) - math.sin(yaw_rad) * PLACE_M,
        0.0,
    )


def _share(weighed: FloatArray) -> FloatArray:
    share = np.exp(weighed - weighed.max())
    shares: FloatArray = share / share.sum()
    return shares


def _find_nearest(comb: Comb) -> float:
    """Find how far left of the robot's way, at PLACE_M ahead, the nearest line of a comb lies."""
    left_m = comb.left_m + comb.bend_per_m * PLACE_M**2 / 2.0
    nearest = _find_line(0.0, np.array(comb.yaw_rad), np.array(left_m), np.array(comb.spacing_m))
    return float(nearest)


def _spread(comb: Comb, grid: RowGrid, compared: Compared, weighed: FloatArray) -> FarLine:
    """Take the line of a comb at its `left_m`, and how far the nearest ones of others lie off."""
    yaw_rad = comb.yaw_rad + math.atan(comb.bend_per_m * PLACE_M)
    left_m = comb.left_m + comb.bend_per_m * PLACE_M**2 / 2.0
    y_m = left_m / math.cos(comb.yaw_rad) + math.tan(comb.yaw_rad) * PLACE_M
    share = _share(weighed)
    yaws_rad = np.broadcast_to(grid.yaws_rad[:, None], share.shape)
    turned_rad = yaws_rad - comb.yaw_rad
    aside_m = _find_line(y_m, yaws_rad, compared.left_m.astype(np.float64), grid.spacings_m) - y_m
    turned2 = float((share * turned_rad**2).sum())
    both = float((share * turned_rad * aside_m).sum())
    on_m = min(max(-both / max(turned2, 1e-9), NEAREST_M - PLACE_M), FARTHEST_M - PLACE_M)
    across2 = float((share * (aside_m + on_m * turned_rad) ** 2).sum())
    return FarLine(
        x_m=PLACE_M + on_m,
        y_m=y_m + on_m * math.tan(yaw_rad) + comb.bend_per_m * on_m**2 / 2.0,
        yaw_rad=yaw_rad + comb.bend_per_m * on_m,
        across_std_m=math.hypot(math.sqrt(across2), LEAST_ACROSS_STD_M),
        yaw_std_rad=math.hypot(math.sqrt(turned2), LEAST_YAW_STD_RAD),
        spacing_m=comb.spacing_m,
        tilt_rad=comb.tilt_rad,
    )


def _find_line(
    y_m: float, yaws_rad: FloatArray, left_m: FloatArray, spacings_m: FloatArray
) -> FloatArray:
    """Find where, at PLACE_M ahead, the lines of combs nearest to `y_m` lie to the left."""
    off_m = np.cos(yaws_rad) * y_m - np.sin(yaws_rad) * PLACE_M - left_m
    off_m = off_m - spacings_m * np.round(off_m / spacings_m)
    found: FloatArray = y_m - off_m / np.cos(yaws_rad)
    return found
