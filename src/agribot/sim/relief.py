"""The relief of a field: rough ground, clods, ridges with furrows, wheel tracks, stones and straw.

Every height is a function of the seed and of the place in the map alone, so that any part of a
field is the same in any grid.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from agribot.core.messages import FloatArray, Row
from agribot.core.row_shape import row_length_m, row_points_map_m, start_yaw_rad
from agribot.core.world import GroundTile, Relief, WorldSpec
from agribot.sim.jit import compile_exact
from agribot.sim.random_streams import make_stream

# Side of a tile. Random ground is the sum of two periodic squares, the second turned and of another
# period, so that their sum repeats nowhere.
TILE_SAMPLES = 1024
TILE_PERIODS_M, TILE_TURNS_RAD = (17.0, 13.7), (0.0, 0.6)
SHORTEST_M, LONGEST_M = 0.1, 5.0
CELL_M = 1.0  # side of the square metre whose clods are drawn by themselves
SMALLEST_CLOD_M = 0.01
WIDEST_CLOD_M = 0.08
RIDGE_PITCH_M = 1.0  # the widest ridge with its furrows
RIDGE_CLODS_RATIO = 0.5  # share of its clods that a packed ridge keeps
ROW_END_M = 0.5  # length of ridges and tracks beyond the plants at the ends
SHOULDER_M = 0.03  # width of a wheel track's shoulder
STONE_HEIGHT_M, STRAW_HEIGHT_M = 0.015, 0.004


Grid = np.ndarray[tuple[int, ...], np.dtype[np.floating[Any]]]  # grid of single or double precision
Indices = np.ndarray[tuple[int, ...], np.dtype[np.signedinteger[Any]]]


class Axes(NamedTuple):
    """Samples along map x (columns,) and y (rows,), `step_m` apart."""

    x_m: FloatArray
    y_m: FloatArray
    step_m: float


def has_relief(relief: Relief) -> bool:
    return bool(
        relief.roughness_rms_m
        or relief.clods_per_m2
        or (relief.rows and (relief.ridge_height_m or relief.track_depth_m))
    )


def make_relief(world: WorldSpec, axes: Axes) -> FloatArray:
    """Make the heights of a world's relief over its plane or terrain, m, (rows, columns)."""
    relief = world.relief
    height_m = np.zeros((len(axes.y_m), len(axes.x_m)))
    if relief.roughness_rms_m > 0.0:
        _add_roughness(relief, axes, height_m)
    tracks_m = np.zeros_like(height_m, dtype=np.float32)
    ridges_m = np.full_like(tracks_m, np.inf)  # the distance from the nearest row at first
    for row in relief.rows:
        _lay_row(relief, row, axes, ridges_m, tracks_m)
    half_m = _find_half_pitch_m(relief.rows)
    _shape_ridges(ridges_m, half_m, relief.ridge_height_m)
    if relief.clods_per_m2 > 0.0:
        clods = _draw_clods(relief, axes)
        kept = _find_clods_on_soil(world.ground, clods)
        kept &= _sample(tracks_m, axes, clods) <= 0.0
        packed = _sample(ridges_m, axes, clods) > 0.0
        kept &= ~packed | (clods[:, 6] < RIDGE_CLODS_RATIO)
        lumps_m = np.zeros_like(tracks_m)
        _stamp_clods(clods[kept], axes.x_m[0], axes.y_m[0], axes.step_m, lumps_m)
        height_m += lumps_m
    height_m += ridges_m
    height_m -= tracks_m
    if world.soil.stones_ratio or world.soil.residue_ratio:
        _add_litter(world, axes, height_m)
    return height_m


def make_rough_tile(relief_seed: int, index: int) -> FloatArray:
    """Make a periodic square (n, n) of isotropic random ground with a deviation of 1.

    A track across it has a displacement PSD ~ n^-2 between the shortest and the longest wave, as
    roads and fields in ISO 8608; in two dimensions that is ~ n^-3.
    """
    period_m = TILE_PERIODS_M[index]
    along = np.fft.fftfreq(TILE_SAMPLES, period_m / TILE_SAMPLES)
    across = np.fft.rfftfreq(TILE_SAMPLES, period_m / TILE_SAMPLES)
    waves_per_m = np.hypot(along[:, None], across[None, :])
    passed = (waves_per_m >= 1.0 / LONGEST_M) & (waves_per_m <= 1.0 / SHORTEST_M)
    rng = make_stream(relief_seed, f"rough ground {index}")
    white = np.fft.rfft2(rng.standard_normal((TILE_SAMPLES, TILE_SAMPLES)))
    gain = np.where(passed, np.maximum(waves_per_m, 1e-9) ** -1.5, 0.0)
    tile: FloatArray = np.fft.irfft2(white * gain, s=(TILE_SAMPLES, TILE_SAMPLES))
    return np.ascontiguousarray(tile / tile.std())


def _add_roughness(relief: Relief, axes: Axes, height_m: FloatArray) -> None:
    share = relief.roughness_rms_m / math.sqrt(len(TILE_PERIODS_M))
    for index, (period_m, turn_rad) in enumerate(zip(TILE_PERIODS_M, TILE_TURNS_RAD, strict=True)):
        _add_turned(
            make_rough_tile(relief.seed, index) * share, TILE_SAMPLES / period_m,
            math.cos(turn_rad), math.sin(turn_rad), axes.x_m, axes.y_m, height_m,
        )  # fmt: skip


@compile_exact
def _add_turned(
    tile: FloatArray, per_m: float, cos: float, sin: float, x_m: FloatArray, y_m: FloatArray,
    height_m: FloatArray,
) -> None:  # fmt: skip
    """Add a periodic square, turned about the map's origin, interpolated between its samples."""
    size = tile.shape[0]
    for r in range(y_m.shape[0]):
        for c in range(x_m.shape[0]):
            u = (x_m[c] * cos + y_m[r] * sin) * per_m
            v = (y_m[r] * cos - x_m[c] * sin) * per_m
            i, j = math.floor(u), math.floor(v)
            u, v = u - i, v - j
            i, j = i % size, j % size
            k, m = (i + 1) % size, (j + 1) % size
            low = tile[j, i] * (1.0 - u) + tile[j, k] * u
            high = tile[m, i] * (1.0 - u) + tile[m, k] * u
            height_m[r, c] += low * (1.0 - v) + high * v


def _lay_row(relief: Relief, row: Row, axes: Axes, off_m: Grid, tracks_m: Grid) -> None:
    """Note where the row is the nearest one (`off_m`) and sink the tracks astride it."""
    around_m = max(
        1.5 * RIDGE_PITCH_M, relief.track_gauge_m / 2.0 + relief.track_width_m + SHOULDER_M
    ) + ROW_END_M  # fmt: skip
    points = row_points_map_m(row)
    low, high = points.min(axis=0) - around_m, points.max(axis=0) + around_m
    columns = np.searchsorted(axes.x_m, (low[0], high[0]))
    rows = np.searchsorted(axes.y_m, (low[1], high[1]))
    depth_m = relief.track_depth_m if relief.track_gauge_m > 0.0 else 0.0
    _lay_line(
        columns, rows, axes.x_m, axes.y_m, *row.start_map_m, start_yaw_rad(row),
        row.curvature_radpm, row_length_m(row), depth_m, relief.track_gauge_m / 2.0,
        relief.track_width_m / 2.0, off_m, tracks_m,
    )  # fmt: skip


@compile_exact
def _lay_line(
    columns: Indices, rows: Indices, x_m: FloatArray, y_m: FloatArray, start_x_m: float,
    start_y_m: float, yaw_rad: float, bend: float, length_m: float, depth_m: float, half_m: float,
    half_width_m: float, off_m: Grid, tracks_m: Grid,
) -> None:  # fmt: skip
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    for r in range(rows[0], rows[1]):
        for c in range(columns[0], columns[1]):
            dx, dy = x_m[c] - start_x_m, y_m[r] - start_y_m
            along, left = dx * cos + dy * sin, dy * cos - dx * sin
            if bend != 0.0:
                out, on = 1.0 - bend * left, bend * along
                along = math.atan2(on, out) / bend
                left = (1.0 - math.hypot(on, out)) / bend
            beyond = max(-along, along - length_m)
            if beyond >= ROW_END_M:
                continue
            left = abs(left)
            # Beyond its ends a row fades: as if it were farther off.
            fade = 1.0 if beyond <= 0.0 else 0.5 + 0.5 * math.cos(math.pi * beyond / ROW_END_M)
            off_m[r, c] = min(off_m[r, c], left + (1.0 - fade) * RIDGE_PITCH_M)
            shoulder = 0.5 + (half_width_m - abs(left - half_m)) / SHOULDER_M
            shoulder = min(max(shoulder, 0.0), 1.0)
            shoulder *= shoulder * (3.0 - 2.0 * shoulder) * fade
            tracks_m[r, c] = max(tracks_m[r, c], depth_m * shoulder)


def _find_half_pitch_m(rows: tuple[Row, ...]) -> float:
    """Return half the distance of neighbouring rows, which is where the furrow lies."""
    middles = [np.mean(row_points_map_m(row), axis=0) for row in rows]
    gaps_m = [
        min(float(np.hypot(*(a - b))) for j, b in enumerate(middles) if i != j)
        for i, a in enumerate(middles)
        if len(middles) > 1
    ]
    return min([RIDGE_PITCH_M, *(gap for gap in gaps_m if gap > 0.1)]) / 2.0


def _shape_ridges(off_m: Grid, half_m: float, top_m: float) -> None:
    """Turn the distance from a row into the height of its ridge and furrow, in place.

    The mean of ridge and furrow is the ground as it was before; the outer furrow rises to it.
    """
    near = np.minimum(off_m / half_m, 2.0)
    off_m[:] = np.where(
        near < 1.0,
        0.5 * top_m * np.cos(np.pi * near),
        -0.25 * top_m * (1.0 + np.cos(np.pi * (near - 1.0))),
    )


def _draw_clods(relief: Relief, axes: Axes) -> FloatArray:
    """Draw the clods around a grid, (n, 7): x, y, radius, height, angle, lobes, a random number.

    Small ones are many: the logarithm of the height is even, weighted to its lower end.
    """
    first = np.floor((np.array([axes.x_m[0], axes.y_m[0]]) - WIDEST_CLOD_M) / CELL_M).astype(int)
    last = np.floor((np.array([axes.x_m[-1], axes.y_m[-1]]) + WIDEST_CLOD_M) / CELL_M).astype(int)
    least_m = min(SMALLEST_CLOD_M, 0.5 * relief.clod_height_m)
    clods = [np.empty((0, 7))]
    for row in range(first[1], last[1] + 1):
        for column in range(first[0], last[0] + 1):
            rng = np.random.default_rng([relief.seed, column + 2**30, row + 2**30, 11])
            draw = rng.random((int(rng.poisson(relief.clods_per_m2 * CELL_M**2)), 7))
            clods.append(draw + np.array([column, row, 0, 0, 0, 0, 0]) * CELL_M)
    drawn = np.concatenate(clods)
    ratio = relief.clod_height_m / least_m
    drawn[:, 3] = least_m * ratio ** (drawn[:, 3] ** 1.5)
    drawn[:, 2] = np.minimum(drawn[:, 3] * (0.8 + 0.6 * drawn[:, 2]), WIDEST_CLOD_M / 2.0)
    drawn[:, 4] *= 2.0 * math.pi
    return drawn


def _find_clods_on_soil(
    ground: tuple[GroundTile, ...], clods: FloatArray
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which clods (n, 7) lie on bare soil, not on grass, pavement or a track."""
    kept = np.ones(len(clods), dtype=bool)
    x, y = clods[:, 0], clods[:, 1]
    for tile in ground:
        inside = (x >= tile.x_min_m) & (x < tile.x_max_m) & (y >= tile.y_min_m) & (y < tile.y_max_m)
        kept[inside] = tile.surface == "soil"
    return kept


def _sample(grid: Grid, axes: Axes, places: FloatArray) -> FloatArray:
    """Return the samples of a grid next to places (n, 2 or more)."""
    columns = np.rint((places[:, 0] - axes.x_m[0]) / axes.step_m).astype(int)
    rows = np.rint((places[:, 1] - axes.y_m[0]) / axes.step_m).astype(int)
    picked: FloatArray = grid[
        np.clip(rows, 0, grid.shape[0] - 1), np.clip(columns, 0, grid.shape[1] - 1)
    ]
    return picked


@compile_exact
def _stamp_clods(
    clods: FloatArray, x_min_m: float, y_min_m: float, step_m: float, lumps_m: Grid
) -> None:
    """Raise the grid to the clods (n, 7): rounded lumps with an uneven outline.

    A clod smaller than the grid can hold is as much wider as it is lower.
    """
    for n in range(clods.shape[0]):
        x, y, radius, top = clods[n, 0], clods[n, 1], clods[n, 2], clods[n, 3]
        wide = max(radius, 1.2 * step_m)
        top *= (radius / wide) ** 2
        cos, sin, lobes = math.cos(clods[n, 4]), math.sin(clods[n, 4]), clods[n, 5]
        reach = 1.5 * wide
        first_c = max(0, math.ceil((x - reach - x_min_m) / step_m))
        last_c = min(lumps_m.shape[1] - 1, math.floor((x + reach - x_min_m) / step_m))
        first_r = max(0, math.ceil((y - reach - y_min_m) / step_m))
        last_r = min(lumps_m.shape[0] - 1, math.floor((y + reach - y_min_m) / step_m))
        for r in range(first_r, last_r + 1):
            for c in range(first_c, last_c + 1):
                dx, dy = x_min_m + c * step_m - x, y_min_m + r * step_m - y
                along, across = (dx * cos + dy * sin) / wide, (dy * cos - dx * sin) / wide
                square = along * along + across * across + 1e-12
                # cos 2a and cos 3a of the direction a, without its angle.
                two = (along * along - across * across) / square
                three = along * (2.0 * two - 1.0) / math.sqrt(square)
                out = 1.0 + 0.30 * lobes * two + 0.22 * (1.0 - lobes) * three
                left = 1.0 - square / (out * out)
                if left > 0.0:
                    lumps_m[r, c] = max(lumps_m[r, c], top * left**0.7)


def _add_litter(world: WorldSpec, axes: Axes, height_m: FloatArray) -> None:
    """Add stones and straw, where the texture of the soil shows them."""
    # A world without litter need not import the camera's modules.
    from agribot.sim.camera.surfaces import EARTH, PERIOD_M, build_litter_heights

    soil = world.soil
    litter_m = build_litter_heights(soil, STONE_HEIGHT_M, STRAW_HEIGHT_M, axes.step_m)
    size = litter_m.shape[0]
    columns = np.floor(axes.x_m / PERIOD_M * size).astype(int) % size
    rows = np.floor(axes.y_m / PERIOD_M * size).astype(int) % size
    is_earth = np.ones((len(rows), len(columns)), dtype=bool)
    for tile in world.ground:
        across = (axes.x_m >= tile.x_min_m) & (axes.x_m < tile.x_max_m)
        along = (axes.y_m >= tile.y_min_m) & (axes.y_m < tile.y_max_m)
        is_earth[np.ix_(along, across)] = tile.surface in EARTH
    height_m += np.where(is_earth, litter_m[np.ix_(rows, columns)], 0.0)
