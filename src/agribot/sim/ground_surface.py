"""The ground of a world as one grid of heights, which wheels stand on and the camera sees."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.world import WorldSpec
from agribot.sim.tyre import Terrain

CELL_M = 0.02  # a rut has at least two samples across
MAX_SAMPLES = 4_000_000  # 32 MB; a larger field gets wider cells
MARGIN_M = 4.0  # around plants and start, where wheels press ruts
UNCHANGED = (2**40, -1, 2**40, -1)


class GroundSurface:
    """Heights of the ground, (rows along y, columns along x); wheels may press them down.

    The first sample is at `x_min_m`, `y_min_m`; outside, the edge's height continues. On soil that
    gives way, `sunk_m` keeps how deep wheels have pressed each place for good; else it is (2, 2).
    """

    def __init__(
        self, height_m: FloatArray, x_min_m: float, y_min_m: float, resolution_m: float
    ) -> None:
        self.height_m = np.ascontiguousarray(height_m, dtype=np.float64)
        self.x_min_m, self.y_min_m, self.resolution_m = x_min_m, y_min_m, resolution_m
        self.sunk_m: FloatArray = np.zeros((2, 2))
        self.changed = np.array(UNCHANGED, dtype=np.int64)

    def make_grid(self) -> Terrain:
        """Return the grid for the kernel; it shares the heights."""
        return Terrain(self.height_m, self.x_min_m, self.y_min_m, self.resolution_m)

    def make_sunk_grid(self) -> Terrain:
        """Return the grid of what wheels have pressed down, for the kernel."""
        return Terrain(self.sunk_m, self.x_min_m, self.y_min_m, self.resolution_m)

    def take_changed(self) -> tuple[int, int, int, int] | None:
        """Return the box of heights that changed since the last call, None if none did.

        It is first row, row after the last, first column, column after the last.
        """
        first_row, last_row, first_column, last_column = self.changed.tolist()
        self.changed[:] = UNCHANGED
        if last_row < 0:
            return None
        return first_row, last_row + 1, first_column, last_column + 1


def build_ground_surface(world: WorldSpec) -> GroundSurface:
    """Build the ground of a world: its terrain with its relief, or a plane."""
    surface = _build_hard_ground(world)
    return surface if world.strength.soil_class == "rigid" else refine(surface, world)


def refine(surface: GroundSurface, world: WorldSpec) -> GroundSurface:
    """Make the grid fine enough for ruts around plants, terrain and start."""
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
    if field is None:
        return GroundSurface(np.zeros((2, 2)), 0.0, 0.0, 1.0)
    return GroundSurface(
        field.height_m, float(field.x_min_m), float(field.y_min_m), float(field.resolution_m)
    )
