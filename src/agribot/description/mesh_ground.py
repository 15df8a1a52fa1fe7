"""Ground that a world gives as a mesh: heights on a grid, from the corners of its triangles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.robot import Shape
from agribot.core.world import HeightField

LEAST_SIDE_M = 4.0  # least side of ground that a robot drives on
MOST_CELLS = 1025  # cells on a side
SAME_PLACE_M = 1e-4


class PlacedMesh(NamedTuple):
    """A mesh in the frame of its model: its corners (n, 3), empty without a file, and its box."""

    words: str
    corners_m: FloatArray
    box: Shape


class GroundMesh(NamedTuple):
    """A mesh that may be the ground, its corners in the map, and the model that it is of."""

    mesh: PlacedMesh
    corners_m: FloatArray
    model: int

    @property
    def side_m(self) -> float:
        """The shorter side in plan, m."""
        return float(np.ptp(self.corners_m[:, :2], axis=0).min()) if len(self.corners_m) else 0.0


def choose_ground_mesh(meshes: Sequence[GroundMesh]) -> GroundMesh | None:
    """Choose the widest mesh, None where none is wide enough."""
    wide = [mesh for mesh in meshes if mesh.side_m >= LEAST_SIDE_M]
    return max(wide, key=lambda mesh: mesh.side_m, default=None)


def make_height_field(corners_m: FloatArray) -> HeightField:
    """Make terrain of the corners (n, 3) of a mesh: the highest of each cell, the others filled."""
    places = np.unique((corners_m[:, :2] / SAME_PLACE_M).round(), axis=0)
    low, high = corners_m[:, :2].min(axis=0), corners_m[:, :2].max(axis=0)
    extent_m = high - low
    # As many cells as a square grid with this number of corners.
    step_m = _find_step_m(extent_m, len(places))
    columns, rows = (math.floor(side_m / step_m + 1.001) for side_m in extent_m.tolist())
    heights_m = np.full((rows, columns), -np.inf)
    at = ((corners_m[:, :2] - low) / step_m).round().astype(int)
    row, column = np.minimum(at[:, 1], rows - 1), np.minimum(at[:, 0], columns - 1)
    np.maximum.at(heights_m, (row, column), corners_m[:, 2])
    return HeightField(
        height_m=_fill(np.where(np.isfinite(heights_m), heights_m, np.nan)),
        x_min_m=round(float(low[0]), 9),
        y_min_m=round(float(low[1]), 9),
        resolution_m=step_m,
    )


def transform_points(map_from_model: FloatArray, points_m: FloatArray) -> FloatArray:
    """Transform points (n, 3) by a pose (4, 4)."""
    placed: FloatArray = points_m @ map_from_model[:3, :3].T + map_from_model[:3, 3]
    return placed


def _find_step_m(extent_m: FloatArray, corners: int) -> float:
    """Return the cell side of a grid with `corners` corners, whole in the longer side."""
    x_m, y_m = extent_m.tolist()
    # (x/s + 1)(y/s + 1) = corners
    half = (x_m + y_m) / 2.0
    step_m = (half + math.sqrt(half**2 + (corners - 1.0) * x_m * y_m)) / max(corners - 1.0, 1.0)
    longest_m = max(x_m, y_m)
    cells = min(max(round(longest_m / step_m), 1), MOST_CELLS - 1)
    return float(min(longest_m / cells, x_m, y_m))


def _fill(heights_m: FloatArray) -> FloatArray:
    """Fill cells without a height with the mean of their neighbours, again and again."""
    while np.isnan(heights_m).any():
        padded = np.pad(heights_m, 1, constant_values=np.nan)
        around = np.stack(
            [padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
        )
        known = np.isfinite(around)
        count = known.sum(axis=0)
        mean = np.where(known, around, 0.0).sum(axis=0) / np.maximum(count, 1)
        heights_m = np.where(np.isnan(heights_m) & (count > 0), mean, heights_m)
    return heights_m
