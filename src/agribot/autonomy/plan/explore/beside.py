"""Rows beside the one that the robot drives: crop that keeps one distance from it."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.pose import Pose2

# Rows farther from each other than this are out of view.
FARTHEST_M = 1.5
PIECE_M, BIN_M, LOOKS = 0.25, 0.05, 2
# A row is grown over more than this part of the way along which its place was in view. Between it
# and the driven row lies a strip that is grown over less than this.
GROWN_RATIO, FEWEST_PIECES = 0.5, 4
OUT_BINS, BARE_RATIO = 3, 0.25
COLUMNS = 1024


class Neighbour(NamedTuple):
    """A row `left_m` beside another one, and the pieces along that one at which it bears crop."""

    left_m: float
    pieces: tuple[int, ...]


class Beside:
    """Call `look` with the crop of every picture while a row is driven, `find` at its end."""

    def __init__(self) -> None:
        # Crop seen, by piece along and bin to the left.
        self._crop: Counter[tuple[int, int]] = Counter()
        self._seen: set[tuple[int, int]] = set()

    def look(
        self, line: Pose2, at_m: float, crop_map_m: FloatArray, seen_map_m: FloatArray
    ) -> None:
        """Take in cells with crop, and all cells in view, (N, 2) each.

        `line` is the place of the row `at_m` along it, in its direction.
        """
        self._crop.update(_sort(line, at_m, crop_map_m))
        self._seen.update(_sort(line, at_m, seen_map_m))

    def find(self, side: float) -> Neighbour | None:
        """Find the nearest row to the left (1.0) or to the right (-1.0); None without one."""
        grown = {cell for cell, looks in self._crop.items() if looks >= LOOKS}
        columns: dict[int, tuple[int, ...]] = {}
        is_out = False  # whether it is clear of the leaves of the driven row
        for column in range(round(FARTHEST_M / BIN_M)):
            middle = column if side > 0.0 else -1 - column
            pieces = {piece for piece, at in grown if at == middle}
            seen = {piece for piece, at in self._seen if at == middle}
            is_out = is_out or (column >= OUT_BINS and len(pieces) < BARE_RATIO * len(seen))
            if is_out and len(pieces) >= max(FEWEST_PIECES, GROWN_RATIO * len(seen)):
                columns[middle] = tuple(sorted(pieces))
            elif columns:
                break
        if not columns:
            return None
        weights = [_count_cells(grown, middle) for middle in columns]
        centre = float(np.average(list(columns), weights=weights)) + 0.5
        most = max(columns.values(), key=len)
        return Neighbour(centre * BIN_M, most)


def _count_cells(grown: set[tuple[int, int]], column: int) -> int:
    return sum(at == column for _, at in grown) + 1


def _sort(line: Pose2, at_m: float, places_map_m: FloatArray) -> list[tuple[int, int]]:
    """Sort cells by piece along the row and bin to its left; each pair once."""
    along_m, left_m = line.locate(places_map_m[:, 0], places_map_m[:, 1])
    near = np.abs(left_m) <= FARTHEST_M
    piece = np.floor((along_m[near] + at_m) / PIECE_M).astype(np.int64)
    column = np.floor(left_m[near] / BIN_M).astype(np.int64)
    middle = COLUMNS // 2  # a pair as one number is sorted ten times faster
    pairs = np.unique(piece * COLUMNS + column + middle)
    return [(pair // COLUMNS, pair % COLUMNS - middle) for pair in pairs.tolist()]
