"""Weed maps as tables: a million plants in a hundred megabytes, of one run or of many.

A row is one plant as one weed map has it. Rows of a `group` are one plant that several maps have:
a merged map keeps what it was merged from, so that merging again counts nothing twice.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.geo import Datum, MapFrame
from agribot.core.implement.plants import REASONS
from agribot.core.messages import FloatArray, MappedPlant, PlantClass

Rows = npt.NDArray[np.void]
IndexArray = npt.NDArray[np.int64]

DECISIONS = ("", "treat", "spare")
OUTCOMES = ("", "treated", "missed", "seen again")
# Row of the table. `map` is an index into the table's names, `reason` one into `REASONS`; NaN:
# unknown.
ROW = np.dtype(
    [
        ("map", "i4"), ("id", "i8"), ("group", "i8"), ("plant", "u1"), ("decision", "u1"),
        ("outcome", "u1"), ("reason", "u1"), ("sightings", "i4"), ("x_map_m", "f8"),
        ("y_map_m", "f8"), ("xx_m2", "f8"), ("xy_m2", "f8"), ("yy_m2", "f8"), ("area_m2", "f8"),
        ("confidence", "f8"), ("first_seen_s", "f8"), ("last_seen_s", "f8"), ("treated_s", "f8"),
    ]
)  # fmt: skip
DEGREE_DECIMALS = 9  # 0.1 mm on the ground
ROW_DECIMALS = {
    "xx_m2": 10, "xy_m2": 10, "yy_m2": 10, "area_m2": 7, "confidence": 5, "first_seen_s": 4,
    "last_seen_s": 4, "treated_s": 4,
}  # fmt: skip


class PlantTable(NamedTuple):
    """Rows of `ROW` in the map of a datum; `maps` are the names of the weed maps they come from."""

    datum: Datum
    maps: tuple[str, ...]
    rows: Rows

    @property
    def frame(self) -> MapFrame:
        return MapFrame(self.datum)

    @property
    def xy_m(self) -> FloatArray:
        """Places in the map, (N, 2)."""
        return np.column_stack([self.rows["x_map_m"], self.rows["y_map_m"]])

    @property
    def is_merged(self) -> bool:
        """Whether some plant has several rows."""
        return len(self.rows) > 0 and int(self.rows["group"].max()) + 1 < len(self.rows)


def tabulate_plants(plants: Iterable[MappedPlant], datum: Datum, name: str) -> PlantTable:
    """Make the table of one run's weed map; nothing is decided yet."""
    values = [
        (
            0, plant.id, number, int(plant.plant), 0, 0, REASONS.index(plant.left),
            plant.sightings, plant.x_map_m, plant.y_map_m, plant.cov_m2[0],
            (plant.cov_m2[1] + plant.cov_m2[2]) / 2.0,
            plant.cov_m2[3], plant.area_m2, plant.confidence, plant.first_seen_s,
            plant.last_seen_s, np.nan if plant.treated_s is None else plant.treated_s,
        )
        for number, plant in enumerate(plants)
    ]  # fmt: skip
    return PlantTable(datum, (name,), np.array(values, dtype=ROW))


def round_rows(table: PlantTable) -> PlantTable:
    """Round all numbers as files have them, so that a map and its file are one and the same."""
    rows, frame = table.rows.copy(), table.frame
    places = np.round(frame.lonlat_from_map(table.xy_m), DEGREE_DECIMALS)
    rows["x_map_m"], rows["y_map_m"] = frame.map_from_lonlat(places).T
    for name, decimals in ROW_DECIMALS.items():
        rows[name] = np.round(rows[name], decimals)
    return table._replace(rows=rows)


def move_to_datum(table: PlantTable, datum: Datum) -> PlantTable:
    """Express the same places in the map of another datum nearby."""
    if table.datum == datum:
        return table
    rows = table.rows.copy()
    xy_m = MapFrame(datum).map_from_lonlat(table.frame.lonlat_from_map(table.xy_m))
    rows["x_map_m"], rows["y_map_m"] = xy_m[:, 0], xy_m[:, 1]
    return PlantTable(datum, table.maps, rows)


def read_column(rows: Rows, name: str) -> FloatArray:
    """Read a column of numbers, (N,).

    To a type checker `rows[name]` may be anything, and sums of such columns keep it busy for
    seconds.
    """
    values: FloatArray = rows[name]
    return values


def compute_std_m(rows: Rows) -> FloatArray:
    """Compute the longer axis of each 1-sigma ellipse, (N,)."""
    xx_m2, xy_m2, yy_m2 = (read_column(rows, name) for name in ("xx_m2", "xy_m2", "yy_m2"))
    half_m2 = (xx_m2 + yy_m2) / 2.0
    root_m2 = np.hypot((xx_m2 - yy_m2) / 2.0, xy_m2)
    std_m: FloatArray = np.sqrt(np.maximum(half_m2 + root_m2, 0.0))
    return std_m


def is_crop(rows: Rows) -> npt.NDArray[np.bool_]:
    """Return for each row whether it is a crop plant, (N,)."""
    crop: npt.NDArray[np.bool_] = rows["plant"] == PlantClass.CROP
    return crop


def number_groups(first_rows: Sequence[int] | IndexArray) -> IndexArray:
    """Count the groups from 0 on, given for each row the first row of its group."""
    _, numbers = np.unique(np.asarray(first_rows, dtype=np.int64), return_inverse=True)
    return numbers.astype(np.int64)
