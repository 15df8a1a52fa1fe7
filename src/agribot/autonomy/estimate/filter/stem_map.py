"""Crop plants that an earlier run mapped, to be found again: which stands nearest to a place."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray

# Plants farther from a place than this are not what was seen there.
REACH_M = 0.15
# Squares of the raster that says which plant is nearest, and of the one that counts plants.
NEAREST_CELL_M, COUNT_CELL_M = 0.05, 0.1
MARGIN_M = 1.0
NO_PLANT = -1

IndexArray = npt.NDArray[np.int32]


class StemMap:
    """Stems of crop, (N, 2) in the map. Places outside of them have no plants."""

    def __init__(self, stems_map_m: FloatArray) -> None:
        self.stems_map_m = np.asarray(stems_map_m, dtype=np.float64).reshape(-1, 2)
        corners = self.stems_map_m if len(self.stems_map_m) else np.zeros((1, 2))
        self._low_m = corners.min(axis=0) - MARGIN_M
        self._size_m = corners.max(axis=0) + MARGIN_M - self._low_m
        self._nearest = self._draw_nearest()
        self._counts = self._count()

    def find_nearest(self, x_m: FloatArray, y_m: FloatArray) -> IndexArray:
        """Give the plant nearest to places (...); NO_PLANT where none is near."""
        return _look_up(self._nearest, self._low_m, NEAREST_CELL_M, x_m, y_m, NO_PLANT)

    def count_in_cells(self, x_m: FloatArray, y_m: FloatArray) -> IndexArray:
        """Count the plants in the squares of COUNT_CELL_M in which places (...) lie."""
        return _look_up(self._counts, self._low_m, COUNT_CELL_M, x_m, y_m, 0)

    def list_near(self, x_m: float, y_m: float, reach_m: float) -> FloatArray:
        """List the stems inside a square, (N, 2)."""
        off_m = np.abs(self.stems_map_m - (x_m, y_m)).max(axis=1)
        near: FloatArray = self.stems_map_m[off_m <= reach_m]
        return near

    def _draw_nearest(self) -> IndexArray:
        """Stamp every plant on the squares around it; the nearest one comes last and stays."""
        shape = tuple(np.ceil(self._size_m / NEAREST_CELL_M).astype(int) + 1)
        reach = round(REACH_M / NEAREST_CELL_M) + 1
        steps = np.arange(-reach, reach + 1)
        around = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        cells = np.floor((self.stems_map_m - self._low_m) / NEAREST_CELL_M).astype(int)
        patch = cells[:, None] + around[None]
        middle_m = self._low_m + (patch + 0.5) * NEAREST_CELL_M
        apart_m = np.hypot(*np.moveaxis(middle_m - self.stems_map_m[:, None], -1, 0))
        order = np.argsort(-apart_m, axis=None)
        stem = np.repeat(np.arange(len(cells), dtype=np.int32), len(around))[order]
        flat = patch.reshape(-1, 2)[order]
        raster = np.full(shape, NO_PLANT, dtype=np.int32)
        raster[flat[:, 0], flat[:, 1]] = stem
        return raster

    def _count(self) -> IndexArray:
        shape = tuple(np.ceil(self._size_m / COUNT_CELL_M).astype(int) + 1)
        cells = np.floor((self.stems_map_m - self._low_m) / COUNT_CELL_M).astype(int)
        raster = np.zeros(shape, dtype=np.int32)
        np.add.at(raster, (cells[:, 0], cells[:, 1]), 1)
        return raster


def _look_up(
    raster: IndexArray, low_m: FloatArray, cell_m: float, x_m: FloatArray, y_m: FloatArray,
    outside: int,
) -> IndexArray:  # fmt: skip
    column = np.floor((x_m - low_m[0]) / cell_m).astype(np.int64)
    row = np.floor((y_m - low_m[1]) / cell_m).astype(np.int64)
    inside = (column >= 0) & (row >= 0) & (column < raster.shape[0]) & (row < raster.shape[1])
    found = raster[np.where(inside, column, 0), np.where(inside, row, 0)]
    return np.where(inside, found, np.int32(outside)).astype(np.int32)
