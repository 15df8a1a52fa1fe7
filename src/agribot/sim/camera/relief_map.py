"""The relief of the ground for the camera: heights, how the sun lights them, and coarser copies."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from agribot.sim.camera.arrays import Bytes, Doubles, Longs, Singles
from agribot.sim.camera.shadows import LOWEST_SUN
from agribot.sim.ground_surface import GroundSurface
from agribot.sim.jit import compile_fast, inline_fast

LEVELS = 8
FINE_SAMPLES = 2_000_000  # largest number of heights whose light is drawn twice as fine
UNIT = 128.0  # byte of light of level ground in the sun
RISE_M = 0.25  # largest height of ground that casts a shadow on the ground nearby
PENUMBRA = 0.08  # width over the distance from the shadow's caster, and at least
PENUMBRA_M = 0.002
HOLLOW_LEVEL = 2  # the copy of the heights against which a hollow is dark
HOLLOW_M, DARKEST, BRIGHTEST = 0.035, 0.45, 1.12
CRUMB_SLOPE = 0.16  # slope of crumbs finer than any grid
REFRESH_M = 2.0  # wheels change the ground no farther from the robot than this
AROUND = 2  # samples whose slope a changed one changes


class ReliefMap(NamedTuple):
    """Heights and light of the ground, with copies of half the samples each.

    `height` and `light` hold the samples of all copies end to end; `levels` and `light_levels`
    (n, 3) say where each begins and its rows and columns. `light` (samples, 2) is the sunlight
    and the light of the sky, 128 for level ground. The first sample of every copy lies at
    `x_m`, `y_m`; those of the finest are `step_m` and `light_step_m` apart.
    """

    height: Singles
    levels: Longs
    light: Bytes
    light_levels: Longs
    x_m: float
    y_m: float
    step_m: float
    light_step_m: float
    top_m: float


class SunOnRelief(NamedTuple):
    """The sun as the relief meets it; `direct` is 1 under a clear sky."""

    x: float
    y: float
    z: float
    direct: float


def build_relief_map(ground: GroundSurface, to_sun: Doubles, direct: float) -> ReliefMap | None:
    """Build the map of a ground under a sun in direction `to_sun` (3,); None of a smooth one."""
    if not ground.has_detail:
        return None
    rows, columns = ground.height_m.shape
    fine = 2 if rows * columns <= FINE_SAMPLES else 1
    levels = _list_levels(rows, columns)
    light_levels = _list_levels((rows - 1) * fine + 1, (columns - 1) * fine + 1)
    relief = ReliefMap(
        height=np.zeros(_count_samples(levels), np.float32),
        levels=levels,
        light=np.zeros((_count_samples(light_levels), 2), np.uint8),
        light_levels=light_levels,
        x_m=ground.x_min_m,
        y_m=ground.y_min_m,
        step_m=ground.resolution_m,
        light_step_m=ground.resolution_m / fine,
        top_m=float(ground.height_m.max()),
    )
    refresh_relief_map(relief, ground, to_sun, direct, (0, rows, 0, columns))
    return relief


def refresh_relief_map(
    relief: ReliefMap,
    ground: GroundSurface,
    to_sun: Doubles,
    direct: float,
    box: tuple[int, int, int, int],
) -> None:
    """Take over the heights of a box (first and last row, first and last column; ends excluded)."""
    sun = SunOnRelief(float(to_sun[0]), float(to_sun[1]), float(to_sun[2]), direct)
    relief.height[: ground.height_m.size].reshape(ground.height_m.shape)[
        box[0] : box[1], box[2] : box[3]
    ] = ground.height_m[box[0] : box[1], box[2] : box[3]]
    _shrink_box(relief.height[:, None], relief.levels, np.array(box))
    shade = max(math.hypot(sun.x, sun.y), 1e-6) / max(sun.z, LOWEST_SUN) * RISE_M
    reach = math.ceil(shade / relief.step_m) + (AROUND << HOLLOW_LEVEL)
    fine = round(relief.step_m / relief.light_step_m)
    wide = np.array([
        max(0, box[0] - reach) * fine, min(relief.levels[0, 1], box[1] + reach) * fine,
        max(0, box[2] - reach) * fine, min(relief.levels[0, 2], box[3] + reach) * fine,
    ])  # fmt: skip
    wide[1] = min(wide[1], relief.light_levels[0, 1])
    wide[3] = min(wide[3], relief.light_levels[0, 2])
    _bake_light(relief, sun, wide)
    _shrink_box(relief.light, relief.light_levels, wide)


def find_change(
    relief: ReliefMap, ground: GroundSurface, x_m: float, y_m: float
) -> tuple[int, int, int, int] | None:
    """Find the box of heights near a place that differ from what the map shows, or None."""
    rows, columns = ground.height_m.shape
    reach = math.ceil(REFRESH_M / relief.step_m)
    row = round((y_m - relief.y_m) / relief.step_m)
    column = round((x_m - relief.x_m) / relief.step_m)
    low_r, high_r = max(0, row - reach), min(rows, row + reach + 1)
    low_c, high_c = max(0, column - reach), min(columns, column + reach + 1)
    if low_r >= high_r or low_c >= high_c:
        return None
    window = (slice(low_r, high_r), slice(low_c, high_c))
    shown = relief.height[: rows * columns].reshape(rows, columns)[window]
    differs = shown != ground.height_m[window].astype(np.float32)
    if not differs.any():
        return None
    along, across = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    return (
        int(low_r + along[0]), int(low_r + along[-1] + 1),
        int(low_c + across[0]), int(low_c + across[-1] + 1),
    )  # fmt: skip


def _list_levels(rows: int, columns: int) -> Longs:
    levels, first = [], 0
    for _ in range(LEVELS):
        levels.append((first, rows, columns))
        first += rows * columns
        rows, columns = max(2, (rows + 1) // 2), max(2, (columns + 1) // 2)
    return np.array(levels, np.int64)


def _count_samples(levels: Longs) -> int:
    return int(levels[-1, 0] + levels[-1, 1] * levels[-1, 2])


def _shrink_box(values: Singles | Bytes, levels: Longs, box: Longs) -> None:
    """Make the coarser copies of `values` (samples, k) again where a box changed."""
    for k in range(1, len(levels)):
        box = np.array([box[0] // 2 - 1, box[1] // 2 + 2, box[2] // 2 - 1, box[3] // 2 + 2])
        box = np.clip(box, 0, np.repeat(levels[k, 1:], 2))
        _shrink(values, levels[k - 1], levels[k], box)


@compile_fast
def _shrink(values: Any, finer: Longs, coarser: Longs, box: Longs) -> None:
    """Fill a box of a copy with means of 3 x 3 samples of the next finer one, weighted 1 2 1."""
    rows, columns = finer[1], finer[2]
    for r in range(box[0], box[1]):
        for c in range(box[2], box[3]):
            for part in range(values.shape[1]):
                total = 0.0
                for down in range(-1, 2):
                    row = min(max(2 * r + down, 0), rows - 1)
                    for right in range(-1, 2):
                        column = min(max(2 * c + right, 0), columns - 1)
                        weight = (2 - abs(down)) * (2 - abs(right))
                        total += weight * values[finer[0] + row * columns + column, part]
                values[coarser[0] + r * coarser[2] + c, part] = total / 16.0


@inline_fast
def sample_relief(
    height: Singles, first: int, rows: int, columns: int, column: float, row: float
) -> float:
    """Interpolate one copy of the heights at a fractional column and row; edges continue."""
    column = min(max(column, 0.0), columns - 1.001)
    row = min(max(row, 0.0), rows - 1.001)
    c, r = int(column), int(row)
    u, v = column - c, row - r
    at = np.uintp(first + r * columns + c)
    under = np.uintp(first + (r + 1) * columns + c)
    low = height[at] * (1.0 - u) + height[at + np.uintp(1)] * u
    high = height[under] * (1.0 - u) + height[under + np.uintp(1)] * u
    return float(low * (1.0 - v) + high * v)


@compile_fast
def _bake_light(relief: ReliefMap, sun: SunOnRelief, box: Longs) -> None:
    """Light a box of the finest copy: slope towards the sun, shadow, and how open the sky is."""
    height, light, levels = relief.height, relief.light, relief.levels
    rows, columns = levels[0, 1], levels[0, 2]
    coarse, coarse_rows, coarse_columns = (
        levels[HOLLOW_LEVEL, 0], levels[HOLLOW_LEVEL, 1], levels[HOLLOW_LEVEL, 2],
    )  # fmt: skip
    share, width = relief.light_step_m / relief.step_m, relief.light_levels[0, 2]
    flat_sun = math.sqrt(sun.x * sun.x + sun.y * sun.y) + 1e-9
    rise = max(sun.z, LOWEST_SUN) / flat_sun * relief.light_step_m
    east, north = sun.x / flat_sun * share, sun.y / flat_sun * share
    steps = math.ceil(RISE_M / rise)
    for r in range(box[0], box[1]):
        for c in range(box[2], box[3]):
            x, y = c * share, r * share
            z = sample_relief(height, 0, rows, columns, x, y)
            slope_x = sample_relief(height, 0, rows, columns, x + 0.8, y)
            slope_x -= sample_relief(height, 0, rows, columns, x - 0.8, y)
            slope_y = sample_relief(height, 0, rows, columns, x, y + 0.8)
            slope_y -= sample_relief(height, 0, rows, columns, x, y - 0.8)
            grain = _mix(c, r)
            slope_x = slope_x / (1.6 * relief.step_m) + CRUMB_SLOPE * ((grain & 255) / 127.5 - 1.0)
            slope_y /= 1.6 * relief.step_m
            slope_y += CRUMB_SLOPE * (((grain >> 8) & 255) / 127.5 - 1.0)
            facing = (sun.z - slope_x * sun.x - slope_y * sun.y) / sun.z
            facing /= math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
            dark, up = 0.0, z
            for k in range(1, steps + 1):
                up += rise
                if dark >= 1.0 or up > relief.top_m:
                    break
                over = sample_relief(height, 0, rows, columns, x + east * k, y + north * k) - up
                if over > 0.0:
                    blur = PENUMBRA * k * relief.light_step_m + PENUMBRA_M
                    dark = max(dark, min(1.0, over / blur))
            smooth = sample_relief(
                height, coarse, coarse_rows, coarse_columns,
                x / (1 << HOLLOW_LEVEL), y / (1 << HOLLOW_LEVEL),
            )  # fmt: skip
            open_sky = min(max(1.0 + (z - smooth) / HOLLOW_M, DARKEST), BRIGHTEST)
            at = r * width + c
            sunlit = 1.0 + (max(0.0, facing) * (1.0 - dark) - 1.0) * sun.direct
            light[at, 0] = np.uint8(min(255.0, UNIT * sunlit + 0.5))
            light[at, 1] = np.uint8(min(255.0, UNIT * open_sky + 0.5))


@compile_fast
def _mix(column: int, row: int) -> int:
    """Mix a place of the grid to 16 random bits and more."""
    state = (column * 73856093) ^ (row * 19349663)
    state = (state ^ (state >> 13)) * 1274126177
    return (state ^ (state >> 16)) & 0xFFFF
