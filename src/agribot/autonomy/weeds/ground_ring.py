"""Cells of ground around the robot, in a ring that moves along with it."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from agribot.autonomy.weeds.pose_shifts import UNSHIFTED
from agribot.core.messages import FloatArray
from agribot.core.pose import Pose2

IndexArray = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

CELL_M = 0.025
# Side of the remembered ground, twice the distance of the view's far end from the boom.
SIDE_CELLS = 256


class BodyCells(Protocol):
    """Square cells of the body frame, row by row from the corner behind and to the right."""

    @property
    def x_body_m(self) -> float: ...
    @property
    def y_body_m(self) -> float: ...
    @property
    def cell_m(self) -> float: ...
    @property
    def rows(self) -> int: ...
    @property
    def columns(self) -> int: ...


class Covered(NamedTuple):
    """Cells of the ground, `i` and `j` (N,), and the row and column of a frame's cell for each."""

    i: IndexArray
    j: IndexArray
    row: IndexArray
    column: IndexArray


class GroundRing:
    """Numbers the cells of the ground and knows which of them are held.

    A cell that is entered anew, `SIDE_CELLS` farther on, takes the place of an older one.
    """

    def __init__(self) -> None:
        self._owner = np.full((2, SIDE_CELLS, SIDE_CELLS), np.iinfo(np.int64).min)
        self.from_map = UNSHIFTED

    def shift(self, shift: Pose2) -> None:
        """Move all cells by a correction of the pose that they were seen from."""
        self.from_map = self.from_map.compose(shift.inverse())

    def find_covered(self, cells: BodyCells, map_from_body: Pose2, shown: Mask) -> Covered:
        """Find the ground that a frame shows, `shown` (rows, columns) of its cells."""
        from_body = self.from_map.compose(map_from_body)
        corners = [
            (cells.x_body_m + at_row * cells.cell_m, cells.y_body_m + at_column * cells.cell_m)
            for at_row in (0, cells.rows)
            for at_column in (0, cells.columns)
        ]
        xs, ys = zip(*(from_body.transform(x, y) for x, y in corners), strict=True)
        i, j = np.meshgrid(
            np.arange(math.floor(min(xs) / CELL_M), math.floor(max(xs) / CELL_M) + 1),
            np.arange(math.floor(min(ys) / CELL_M), math.floor(max(ys) / CELL_M) + 1),
            indexing="ij",
        )
        x_m, y_m = from_body.locate((i + 0.5) * CELL_M, (j + 0.5) * CELL_M)
        row = np.floor((x_m - cells.x_body_m) / cells.cell_m).astype(np.int64)
        column = np.floor((y_m - cells.y_body_m) / cells.cell_m).astype(np.int64)
        found = (row >= 0) & (row < cells.rows) & (column >= 0) & (column < cells.columns)
        found[found] = shown[row[found], column[found]]
        return Covered(i[found], j[found], row[found], column[found])

    def find_cells(self, box: Pose2, x_m: FloatArray, y_m: FloatArray) -> tuple[IndexArray, ...]:
        """Find the numbers of the cells of places (...,) in the frame of a box of the map."""
        x_m, y_m = self.from_map.compose(box).transform(x_m, y_m)
        return np.floor(x_m / CELL_M).astype(np.int64), np.floor(y_m / CELL_M).astype(np.int64)

    def find_held(self, i: IndexArray, j: IndexArray) -> Mask:
        """Return which cells are held, not replaced by an older one or empty."""
        held: Mask = (self._owner[0][wrap(i, j)] == i) & (self._owner[1][wrap(i, j)] == j)
        return held

    def take(self, i: IndexArray, j: IndexArray) -> None:
        """Hold these cells from now on."""
        self._owner[0][wrap(i, j)], self._owner[1][wrap(i, j)] = i, j


def wrap(i: IndexArray, j: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Find the places of cells in the ring."""
    return i % SIDE_CELLS, j % SIDE_CELLS


def spread_steps(half_m: float) -> FloatArray:
    """Spread steps from -half to half, none larger than half a cell."""
    count = max(2, math.ceil(4.0 * half_m / CELL_M) + 1)
    return np.linspace(-half_m, half_m, count)
