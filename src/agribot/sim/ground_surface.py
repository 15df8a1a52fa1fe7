"""The ground of a world as one grid of heights, which wheels stand on and the camera sees."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.row_shape import row_points_map_m
from agribot.core.world import HeightField, WorldSpec
from agribot.sim.relief import Axes, has_relief, make_relief
from agribot.sim.tyre import Terrain

CELL_M = 0.02
MAX_SAMPLES = 4_000_000  # 32 MB; a larger field gets wider cells
MARGIN_M = 4.0  # of relief around plants, rows and start
LEAST_EXTENT_M = 24.0
FADE_M = 1.0  # within the margin, to the plain ground at the edge


class GroundSurface:
    """Heights of the ground, (rows along y, columns along x); wheels may press them down.

    The first sample is at `x_min_m`, `y_min_m`; outside, the edge's height continues. A ground
    that `is_fine` has heights as small as clods: tyres envelop them and the camera shows them.
    """

    def __init__(
        self,
        height_m: FloatArray,
        x_min_m: float,
        y_min_m: float,
        resolution_m: float,
        *,
        is_fine: bool = False,
    ) -> None:
        self.height_m = np.ascontiguousarray(height_m, dtype=np.float64)
        self.x_min_m, self.y_min_m, self.resolution_m = x_min_m, y_min_m, resolution_m
        self.is_fine = is_fine

    def make_grid(self) -> Terrain:
        """Return the grid for the kernel; it shares the heights."""
        return Terrain(self.height_m, self.x_min_m, self.y_min_m, self.resolution_m)

    def sample_heights(self, places_m: FloatArray) -> FloatArray:
        """Interpolate the heights (n,) at map places (n, 2 or more)."""
        rows, columns = self.height_m.shape
        u = np.clip((places_m[:, 0] - self.x_min_m) / self.resolution_m, 0.0, columns - 1.000001)
        v = np.clip((places_m[:, 1] - self.y_min_m) / self.resolution_m, 0.0, rows - 1.000001)
        c, r = u.astype(int), v.astype(int)
        u, v, grid = u - c, v - r, self.height_m
        low = grid[r, c] * (1.0 - u) + grid[r, c + 1] * u
        high = grid[r + 1, c] * (1.0 - u) + grid[r + 1, c + 1] * u
        heights: FloatArray = low * (1.0 - v) + high * v
        return heights


def build_ground_surface(world: WorldSpec) -> GroundSurface:
    """Build the ground of a world: its terrain with its relief, or a plane."""
    field = world.terrain
    if has_relief(world.relief):
        return _build_fine_ground(world)
    if field is None:
        return GroundSurface(np.zeros((2, 2)), 0.0, 0.0, 1.0)
    return GroundSurface(
        field.height_m, float(field.x_min_m), float(field.y_min_m), float(field.resolution_m)
    )


def _build_fine_ground(world: WorldSpec) -> GroundSurface:
    """Build terrain and relief on one grid that covers both; the relief fades at its edge."""
    low, high = _find_extent_m(world)
    inner = (low, high)
    field = world.terrain
    if field is not None:
        rows, columns = field.height_m.shape
        corner = np.array([field.x_min_m, field.y_min_m])
        low = np.minimum(low, corner)
        high = np.maximum(high, corner + field.resolution_m * np.array([columns - 1, rows - 1]))
    step_m = max(CELL_M, math.sqrt(float(np.prod(high - low)) / MAX_SAMPLES))
    axes = _make_axes(low, high, step_m)
    height_m = make_relief(world, axes)
    height_m *= _fade(axes.y_m, inner[0][1], inner[1][1])[:, None]
    height_m *= _fade(axes.x_m, inner[0][0], inner[1][0])[None, :]
    if field is not None:
        height_m += _resample(field, axes)
    return GroundSurface(height_m, float(axes.x_m[0]), float(axes.y_m[0]), step_m, is_fine=True)


def _find_extent_m(world: WorldSpec) -> tuple[FloatArray, FloatArray]:
    """Return the corners of the relief: around plants, rows and start."""
    places = [np.array([world.spawn_xy_map_m])]
    places += [row_points_map_m(row) for row in world.relief.rows]
    if world.plants:
        places.append(np.array([(plant.x_map_m, plant.y_map_m) for plant in world.plants]))
    points = np.concatenate(places)
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    more = np.maximum(0.0, LEAST_EXTENT_M - (high - low)) / 2.0
    return low - more, high + more


def _make_axes(low: FloatArray, high: FloatArray, step_m: float) -> Axes:
    """Make axes whose samples are at multiples of the step, whatever the extent."""
    first, last = np.floor(low / step_m).astype(int), np.ceil(high / step_m).astype(int)
    x_m, y_m = (step_m * np.arange(first[k], last[k] + 1) for k in (0, 1))
    return Axes(x_m, y_m, step_m)


def _fade(at_m: FloatArray, low_m: float, high_m: float) -> FloatArray:
    share = np.clip(np.minimum(at_m - low_m, high_m - at_m) / FADE_M, 0.0, 1.0)
    weight: FloatArray = share * share * (3.0 - 2.0 * share)
    return weight


def _resample(field: HeightField, axes: Axes) -> FloatArray:
    """Interpolate a terrain at the samples of axes, (rows, columns); its edges continue."""
    rows, columns = field.height_m.shape
    u = np.clip((axes.x_m - field.x_min_m) / field.resolution_m, 0.0, columns - 1.000001)
    v = np.clip((axes.y_m - field.y_min_m) / field.resolution_m, 0.0, rows - 1.000001)
    c, r = u.astype(int), v.astype(int)
    u, v = u - c, (v - r)[:, None]
    lines = field.height_m[:, c] * (1.0 - u) + field.height_m[:, c + 1] * u
    heights: FloatArray = lines[r] * (1.0 - v) + lines[r + 1] * v
    return heights
