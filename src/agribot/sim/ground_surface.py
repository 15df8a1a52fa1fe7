"""The ground of a world as one grid of heights, which wheels stand on and the camera sees."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.row_shape import row_points_map_m
from agribot.core.world import WorldSpec
from agribot.sim.relief import Axes, has_relief, make_relief
from agribot.sim.tyre import Terrain

CELL_M = 0.02  # side of a cell: a rut has at least two samples across
MAX_SAMPLES = 4_000_000  # 32 MB; a larger field gets wider cells
MARGIN_M = 4.0  # around plants, rows and start, where wheels press ruts and relief lies
LEAST_EXTENT_M = 24.0  # least extent of relief
FADE_M = 1.0  # within the margin, to the plain ground at the edge


class GroundSurface:
    """Heights of the ground, (rows along y, columns along x); wheels may press them down.

    The first sample is at `x_min_m`, `y_min_m`; outside, the edge's height continues. On soil that
    gives way, `sunk_m` keeps how deep wheels have pressed each place for good; else it is (2, 2).
    A ground that `is_fine` has heights as small as clods, which tyres envelop.
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
        self.sunk_m: FloatArray = np.zeros((2, 2))

    @property
    def has_detail(self) -> bool:
        """Whether the ground is relief, or will be ruts, that a camera should see."""
        return self.is_fine or self.sunk_m.size > 4

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

    def make_sunk_grid(self) -> Terrain:
        """Return the grid of what wheels have pressed down, for the kernel."""
        return Terrain(self.sunk_m, self.x_min_m, self.y_min_m, self.resolution_m)


def build_ground_surface(world: WorldSpec) -> GroundSurface:
    """Build the ground of a world: its terrain with its relief, or a plane."""
    surface = _build_hard_ground(world)
    return surface if world.strength.soil_class == "rigid" else refine(surface, world)


def refine(surface: GroundSurface, world: WorldSpec) -> GroundSurface:
    """Make the grid fine enough for ruts around plants, terrain and start."""
    if surface.is_fine:
        surface.sunk_m = np.zeros_like(surface.height_m)
        return surface
    x_m = [world.spawn_xy_map_m[0], *(plant.x_map_m for plant in world.plants)]
    y_m = [world.spawn_xy_map_m[1], *(plant.y_map_m for plant in world.plants)]
    low = np.array([min(x_m), min(y_m)]) - MARGIN_M
    high = np.array([max(x_m), max(y_m)]) + MARGIN_M
    if world.terrain is not None:
        rows, columns = surface.height_m.shape
        corner = np.array([surface.x_min_m, surface.y_min_m])
        low = np.minimum(low, corner)
        high = np.maximum(high, corner + surface.resolution_m * np.array([columns - 1, rows - 1]))
    step_m = max(CELL_M, math.sqrt(float(np.prod(high - low)) / MAX_SAMPLES))
    columns, rows = (np.ceil((high - low) / step_m).astype(int) + 1).tolist()
    u = (low[0] + step_m * np.arange(columns) - surface.x_min_m) / surface.resolution_m
    v = (low[1] + step_m * np.arange(rows) - surface.y_min_m) / surface.resolution_m
    fine = GroundSurface(_interpolate(surface.height_m, u, v), float(low[0]), float(low[1]), step_m)
    fine.sunk_m = np.zeros_like(fine.height_m)
    return fine


def _interpolate(values: FloatArray, columns: FloatArray, rows: FloatArray) -> FloatArray:
    """Interpolate a grid at columns and rows, fractions allowed; its edges continue."""
    columns = np.clip(columns, 0.0, values.shape[1] - 1.000001)
    rows = np.clip(rows, 0.0, values.shape[0] - 1.000001)
    c, r = columns.astype(int), rows.astype(int)
    u, v = columns - c, (rows - r)[:, None]
    lines = values[:, c] * (1.0 - u) + values[:, c + 1] * u
    fine: FloatArray = lines[r] * (1.0 - v) + lines[r + 1] * v
    return fine


def _build_hard_ground(world: WorldSpec) -> GroundSurface:
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
        height_m += _interpolate(
            np.asarray(field.height_m),
            (axes.x_m - field.x_min_m) / field.resolution_m,
            (axes.y_m - field.y_min_m) / field.resolution_m,
        )
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
