"""Areas that pass over the plants: wheels that crush crops, sections of an implement.

Footprints are boxes on the ground, swept from one tick to the next so that nothing between
two ticks is missed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray
from agribot.core.world import Plant
from agribot.sim.jit import compile_exact

CELL_M = 0.5

IndexArray = npt.NDArray[np.int64]


class PlantGrid(NamedTuple):
    """Plants sorted into square cells; those of cell c are `order[start[c]:start[c + 1]]`."""

    x_map_m: FloatArray
    y_map_m: FloatArray
    radius_m: FloatArray
    order: IndexArray
    start: IndexArray
    columns: int
    rows: int
    x_min_m: float
    y_min_m: float


class Footprints(NamedTuple):
    """Footprints of one kind: centres in the body frame (N, 2), half sizes along and across."""

    xy_body_m: FloatArray
    half_length_m: float
    half_width_m: float
    base_height_m: float


def list_places_m(plants: Sequence[Plant]) -> FloatArray:
    """List where plants stand in the map, (N, 2)."""
    return np.array([(p.x_map_m, p.y_map_m) for p in plants], dtype=np.float64).reshape(-1, 2)


def build_plant_grid(places_m: FloatArray, radius_m: FloatArray) -> PlantGrid:
    """Sort plants by their places (N, 2) into cells; `radius_m` (N,) are those of their stems."""
    x, y = np.ascontiguousarray(places_m.T)
    if not len(places_m):
        none = np.zeros(0, dtype=np.int64)
        return PlantGrid(x, y, radius_m, none, np.zeros(2, dtype=np.int64), 1, 1, 0.0, 0.0)
    x_min, y_min = float(x.min()), float(y.min())
    column = ((x - x_min) / CELL_M).astype(np.int64)
    row = ((y - y_min) / CELL_M).astype(np.int64)
    columns, rows = int(column.max()) + 1, int(row.max()) + 1
    cell = row * columns + column
    order = np.argsort(cell, kind="stable").astype(np.int64)
    start = np.searchsorted(cell[order], np.arange(columns * rows + 1)).astype(np.int64)
    return PlantGrid(x, y, radius_m, order, start, columns, rows, x_min, y_min)


@compile_exact
def mark_swept(
    before: FloatArray,
    after: FloatArray,
    feet: Footprints,
    active: npt.NDArray[np.bool_],
    grid: PlantGrid,
    hit_s: FloatArray,
    t_s: float,
) -> float:
    """Mark the plants that the active footprints passed over; return the area swept, m2.

    `before` and `after` are rows of the physics history, `active` (N,) belongs to the footprints
    and `hit_s` (M,) to the plants: NaN until a plant is hit, then the first `t_s`. A plant is hit
    when its stem, a disc, touches the swept box.
    """
    area_m2 = 0.0
    for k in range(feet.xy_body_m.shape[0]):
        if not active[k]:
            continue
        x0, y0 = project_to_ground(before, feet.xy_body_m[k, 0], feet.xy_body_m[k, 1], feet)
        x1, y1 = project_to_ground(after, feet.xy_body_m[k, 0], feet.xy_body_m[k, 1], feet)
        w, z = after[3], after[6]
        norm = math.hypot(w, z)
        cos, sin = (w * w - z * z) / (norm * norm), 2.0 * w * z / (norm * norm)
        along = abs((x1 - x0) * cos + (y1 - y0) * sin)
        across = abs((y1 - y0) * cos - (x1 - x0) * sin)
        half_x, half_y = feet.half_length_m + along / 2.0, feet.half_width_m + across / 2.0
        _mark_box((x0 + x1) / 2, (y0 + y1) / 2, cos, sin, half_x, half_y, grid, hit_s, t_s)
        area_m2 += 2.0 * feet.half_width_m * along
    return area_m2


@compile_exact
def project_to_ground(
    row: FloatArray, x_body_m: float, y_body_m: float, feet: Footprints
) -> tuple[float, float]:
    """Return the map position, x and y, of a body point on the ground."""
    w, x, y, z = row[3], row[4], row[5], row[6]
    down = -feet.base_height_m
    return (
        row[0]
        + (1 - 2 * (y * y + z * z)) * x_body_m
        + 2 * (x * y - w * z) * y_body_m
        + 2 * (x * z + w * y) * down,
        row[1]
        + 2 * (x * y + w * z) * x_body_m
        + (1 - 2 * (x * x + z * z)) * y_body_m
        + 2 * (y * z - w * x) * down,
    )


@compile_exact
def _mark_box(
    centre_x: float,
    centre_y: float,
    cos: float,
    sin: float,
    half_x: float,
    half_y: float,
    grid: PlantGrid,
    hit_s: FloatArray,
    t_s: float,
) -> None:
    reach = math.hypot(half_x, half_y) + 0.5 * CELL_M
    left = max(0, math.floor((centre_x - reach - grid.x_min_m) / CELL_M))
    right = min(grid.columns - 1, math.floor((centre_x + reach - grid.x_min_m) / CELL_M))
    low = max(0, math.floor((centre_y - reach - grid.y_min_m) / CELL_M))
    high = min(grid.rows - 1, math.floor((centre_y + reach - grid.y_min_m) / CELL_M))
    for row in range(low, high + 1):
        first = grid.start[row * grid.columns + left]
        last = grid.start[row * grid.columns + right + 1] if right >= left else first
        for k in range(first, last):
            plant = grid.order[k]
            dx, dy = grid.x_map_m[plant] - centre_x, grid.y_map_m[plant] - centre_y
            beyond_x = max(0.0, abs(dx * cos + dy * sin) - half_x)
            beyond_y = max(0.0, abs(dy * cos - dx * sin) - half_y)
            radius = grid.radius_m[plant]
            if beyond_x**2 + beyond_y**2 <= radius * radius and math.isnan(hit_s[plant]):
                hit_s[plant] = t_s
