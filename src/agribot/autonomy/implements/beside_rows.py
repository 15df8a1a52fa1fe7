"""Ground beside the rows of a sown field, where leaves reach but no heart of a crop stands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

# Crops of the map so far ahead of the tool and behind it tell where their row runs.
REACH_M = 1.0
LEAST_CROPS = 3
# Hearts stand so near to the line of their row: what the drill and the map are off by.
HALF_ROW_M = 0.08
# By how much a row may run aside of the tool's way, per metre along it.
TURN_RATIO = 0.06
# So far beside itself a row answers for the ground: rows of beets are 45 cm apart and more, so that
# one of which the map knows nothing would be no nearer.
BESIDE_M = 0.4


class RowCrop(NamedTuple):
    """A crop of the map, `x_m` ahead of the tool point and `y_m` to its left."""

    x_m: float
    y_m: float
    is_confirmed: bool


def is_beside_rows(
    left_m: float, half_x_m: float, half_y_m: float, crops: Sequence[RowCrop]
) -> bool:
    """Whether a box at the tool lies beside a row of the map, where no heart of a crop can stand.

    The box reaches `half_x_m` along the way and `half_y_m` across it, around `left_m` to the left
    of the tool point. All of it must lie within 0.4 m of the line of at least three crops, and no
    crop, also one that was seen but once, may stand in line with it. One that the map has missed
    stands in line with its neighbours.
    """
    row_crops = 0
    for crop in crops:
        along_m, across_m = abs(crop.x_m), abs(crop.y_m - left_m)
        if along_m > REACH_M:
            continue
        if across_m - half_y_m < HALF_ROW_M + TURN_RATIO * (along_m + half_x_m):
            return False
        row_crops += crop.is_confirmed and across_m + half_y_m <= BESIDE_M
    return row_crops >= LEAST_CROPS
