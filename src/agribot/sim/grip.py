"""The friction of the ground as a grid that the kernel looks up below every wheel."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.world import WorldSpec
from agribot.sim.soil import compute_surface_friction
from agribot.sim.tyre import Terrain

CELL_M = 0.05  # width of a patch's edge, about the length of a tyre's contact
MAX_SAMPLES = 4_000_000  # 32 MB; patches further apart get wider cells


def build_friction_grid(world: WorldSpec) -> Terrain:
    """Build the grid of the ground's friction with its patches; the edge continues outside.

    Water, stones and straw on the soil take their share everywhere.
    """
    patches, left = world.grip, compute_surface_friction(world.soil)
    if not patches:
        return Terrain(np.full((2, 2), left * world.friction_ratio), 0.0, 0.0, 1.0)
    low = np.array([min(p.x_min_m for p in patches), min(p.y_min_m for p in patches)])
    high = np.array([max(p.x_max_m for p in patches), max(p.y_max_m for p in patches)])
    cell_m = max(CELL_M, math.sqrt(float(np.prod(high - low)) / MAX_SAMPLES))
    low, (columns, rows) = low - cell_m, np.ceil((high - low) / cell_m).astype(int) + 4
    values = np.full((rows, columns), world.friction_ratio)
    x_m, y_m = low[0] + cell_m * np.arange(columns), low[1] + cell_m * np.arange(rows)
    for patch in patches:
        across = (x_m >= patch.x_min_m) & (x_m <= patch.x_max_m)
        along = (y_m >= patch.y_min_m) & (y_m <= patch.y_max_m)
        values[np.ix_(along, across)] = patch.friction_ratio
    return Terrain(left * values, float(low[0]), float(low[1]), cell_m)
