"""The stand of the crop: plants and gaps of each row, as the weed map has them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.autonomy.weeds.plant_table import PlantTable, is_crop
from agribot.core.messages import FloatArray, Row
from agribot.core.row_shape import project_on_row, row_length_m

BESIDE_ROW_M = 0.15  # largest distance of a row's plants from its line
GAP_RATIO = 1.5  # gap over the spacing: a longer way between two plants is a gap
# Fewer plants than this share of what the camera saw as crop: they touch, and cannot be counted.
COUNTABLE_RATIO, LEAST_SEEN_M = 0.5, 1.0


class RowStand(NamedTuple):
    """A crop row by its index: places of its plants along it, (N,), and gaps from and to, (G, 2).

    `spacing_m` is that of the field, or the median between its plants; None with fewer than two.
    `is_countable` is false where the map has too few plants for the crop that the camera saw.
    """

    row: int
    length_m: float
    along_m: FloatArray
    gaps_m: FloatArray
    spacing_m: float | None
    is_countable: bool

    @property
    def missing(self) -> int:
        """Count of plants that would fill the gaps."""
        if self.spacing_m is None:
            return 0
        lengths_m = self.gaps_m[:, 1] - self.gaps_m[:, 0]
        return int(np.maximum(np.round(lengths_m / self.spacing_m) - 1, 0).sum())

    @property
    def bare_m(self) -> float:
        """Length of the row without plants: each gap, less one spacing."""
        if self.spacing_m is None:
            return 0.0
        length_m = float(np.diff(self.gaps_m, axis=1).sum())
        return max(length_m - self.spacing_m * len(self.gaps_m), 0.0)

    @property
    def per_metre(self) -> float:
        return len(self.along_m) / self.length_m if self.length_m else math.nan


def find_stand(
    table: PlantTable, row: Row, spacing_m: float | None = None, seen_m: float | None = None
) -> RowStand:
    """Find plants and gaps of a row between its ends.

    `seen_m` of the row the camera saw as crop, None where that is unknown.
    """
    rows = table.rows[is_crop(table.rows)]
    along_m, left_m, _ = project_on_row(row, rows["x_map_m"], rows["y_map_m"])
    length_m = row_length_m(row)
    is_here = (np.abs(left_m) <= BESIDE_ROW_M) & (along_m >= -BESIDE_ROW_M)
    is_here &= along_m <= length_m + BESIDE_ROW_M
    along_m = np.sort(along_m[is_here])
    if spacing_m is None and len(along_m) > 1:
        spacing_m = float(np.median(np.diff(along_m)))
    gaps_m = np.empty((0, 2))
    if spacing_m is not None:
        # A row begins and ends with a plant.
        ends_m = np.concatenate([[-spacing_m], along_m, [length_m + spacing_m]])
        is_gap = np.diff(ends_m) > GAP_RATIO * spacing_m
        gaps_m = np.column_stack([ends_m[:-1], ends_m[1:]])[is_gap]
    is_countable = True
    if seen_m is not None and seen_m > LEAST_SEEN_M:
        is_countable = len(along_m) * (spacing_m or 0.0) >= COUNTABLE_RATIO * seen_m
    return RowStand(row.index, length_m, along_m, gaps_m, spacing_m, is_countable)
