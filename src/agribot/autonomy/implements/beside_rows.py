"""Ground beside the rows of a sown field, where leaves reach but no heart of a crop stands."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from statistics import median
from typing import NamedTuple

from agribot.autonomy.implements.tool_frame import ToolPose, find_crops
from agribot.core.implement.plants import KnownPlant, PlantMap
from agribot.core.pose import Pose2

# Crops of the map this far ahead of the tool and behind it show where their row runs, m.
REACH_M = 1.0
LEAST_CROPS = 3
# Largest offset of a plant's heart from the line of its row: errors of the drill and the map.
HALF_ROW_M = 0.08
# Half width of a row where enough of its crops are mapped to measure it, m; their number.
FITTED_HALF_ROW_M, LEAST_FITTED = 0.04, 6
ROW_WIDTH_M = 0.12  # width of a line of crops of one row
# Largest deviation of a row from the tool's way, per metre along it, and the accuracy with which
# enough pairs of crops this far apart in a row show it.
TURN_RATIO, FITTED_TURN_RATIO = 0.06, 0.02
PAIR_M, LEAST_PAIRS = 0.4, 6


class RowCrop(NamedTuple):
    """A crop of the map, `x_m` ahead of the tool point and `y_m` to its left."""

    x_m: float
    y_m: float
    is_confirmed: bool


class RowsAround:
    """The rows that the crops of the map around the tool stand in."""

    def __init__(self, crops: Sequence[RowCrop], beside_m: float) -> None:
        """`beside_m` is the distance beside a row within which no unmapped row can stand."""
        near = [crop for crop in crops if abs(crop.x_m) <= REACH_M]
        fitted = _find_turn(near)
        turn, self._unsure = (0.0, TURN_RATIO) if fitted is None else (fitted, FITTED_TURN_RATIO)
        self._half_ratio = abs(turn) + self._unsure
        self._beside_m = beside_m
        # Offset at which the line of each crop's row passes the tool, to the left of the tool
        # point.
        lines_m = [crop.y_m - turn * crop.x_m for crop in near]
        known_m = [m for crop, m in zip(near, lines_m, strict=True) if crop.is_confirmed]
        self._lines = [
            (crop, line_m, sum(abs(m - line_m) <= ROW_WIDTH_M for m in known_m))
            for crop, line_m in zip(near, lines_m, strict=True)
        ]

    def is_beside(self, left_m: float, half_x_m: float, half_y_m: float) -> bool:
        """Whether a box at the tool lies beside a row, where no heart of a crop can stand.

        The box reaches `half_x_m` along the way and `half_y_m` across it, around `left_m` to the
        left of the tool point. All of it must lie near enough to the line of at least three crops,
        and no crop, also one that was seen but once, may stand in line with it. One that the map
        has missed stands in line with its neighbours.
        """
        row_crops = 0
        for crop, line_m, in_line in self._lines:
            across_m = abs(line_m - left_m)
            half_row_m = FITTED_HALF_ROW_M if in_line >= LEAST_FITTED else HALF_ROW_M
            free_m = half_row_m + self._unsure * abs(crop.x_m) + self._half_ratio * half_x_m
            if across_m - half_y_m < free_m:
                return False
            row_crops += crop.is_confirmed and across_m + half_y_m <= self._beside_m
        return row_crops >= LEAST_CROPS


def find_rows_around(tool: ToolPose, plants: PlantMap, beside_m: float) -> RowsAround:
    """Find the rows that the crops of the map around the tool stand in."""
    map_from_tool = Pose2(*tool)
    crops = find_crops(plants, tool, REACH_M + beside_m)
    return RowsAround([_see_from(map_from_tool, crop) for crop in crops], beside_m)


def _see_from(map_from_tool: Pose2, plant: KnownPlant) -> RowCrop:
    x_m, y_m = map_from_tool.locate(plant.x_map_m, plant.y_map_m)
    return RowCrop(x_m, y_m, plant.is_confirmed)


def _find_turn(crops: Sequence[RowCrop]) -> float | None:
    """Find how far the rows deviate from the tool's way, per metre; None with too few crops.

    The median of the lines through two crops: a weed that is called crop does not turn a row.
    """
    known = [crop for crop in crops if crop.is_confirmed]
    ratios = [
        (b.y_m - a.y_m) / (b.x_m - a.x_m)
        for a, b in combinations(known, 2)
        if abs(b.x_m - a.x_m) >= PAIR_M
        and abs(b.y_m - a.y_m) <= HALF_ROW_M + TURN_RATIO * abs(b.x_m - a.x_m)
    ]
    if len(ratios) < LEAST_PAIRS:
        return None
    return median(ratios)


NO_ROWS = RowsAround((), 0.0)  # empty surroundings of the tool
