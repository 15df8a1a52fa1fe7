"""The ground of a world as one grid of heights, which wheels stand on and the camera sees."""

from __future__ import annotations

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.world import WorldSpec
from agribot.sim.tyre import Terrain


class GroundSurface:
    """Heights of the ground, (rows along y, columns along x); wheels may press them down.

    The first sample is at `x_min_m`, `y_min_m`; outside, the edge's height continues.
    """

    def __init__(
        self, height_m: FloatArray, x_min_m: float, y_min_m: float, resolution_m: float
    ) -> None:
        self.height_m = np.ascontiguousarray(height_m, dtype=np.float64)
        self.x_min_m, self.y_min_m, self.resolution_m = x_min_m, y_min_m, resolution_m

    def make_grid(self) -> Terrain:
        """Return the grid for the kernel; it shares the heights."""
        return Terrain(self.height_m, self.x_min_m, self.y_min_m, self.resolution_m)


def build_ground_surface(world: WorldSpec) -> GroundSurface:
    """Build the ground of a world: its terrain with its relief, or a plane."""
    field = world.terrain
    if field is None:
        return GroundSurface(np.zeros((2, 2)), 0.0, 0.0, 1.0)
    return GroundSurface(
        field.height_m, float(field.x_min_m), float(field.y_min_m), float(field.resolution_m)
    )
