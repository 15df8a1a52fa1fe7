"""The columns that every file of a weed map has, and the way from table to records and back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np

from agribot.autonomy.weeds.merge import fuse
from agribot.autonomy.weeds.plant_table import (
    DECISIONS,
    DEGREE_DECIMALS,
    OUTCOMES,
    ROW,
    ROW_DECIMALS,
    PlantTable,
    Rows,
    compute_std_m,
)
from agribot.core.geo import Datum
from agribot.core.implement.plants import REASONS
from agribot.core.messages import FloatArray, PlantClass

# Name -> SQLite's type, in the order of the files.
COLUMNS = {
    "id": "INTEGER", "class": "TEXT", "confidence": "REAL", "decision": "TEXT", "outcome": "TEXT",
    "reason": "TEXT", "std_m": "REAL", "xx_m2": "REAL", "xy_m2": "REAL", "yy_m2": "REAL",
    "area_m2": "REAL", "sightings": "INTEGER", "first_seen_s": "REAL", "last_seen_s": "REAL",
    "treated_s": "REAL",
    "x_map_m": "REAL", "y_map_m": "REAL", "map": "TEXT", "map_id": "INTEGER", "maps": "INTEGER",
    "evidence": "TEXT",
}  # fmt: skip
MAX_PLANTS = 5_000_000
CHUNK = 8192
DEFAULT_STD_M = 0.1  # default of a foreign map that states no accuracy of its places
CLASSES = {PlantClass.WEED: "weed", PlantClass.CROP: "crop"}
_DECIMALS = {**ROW_DECIMALS, "x_map_m": 4, "y_map_m": 4, "std_m": 5}
DECISION_CODES = {name: code for code, name in enumerate(DECISIONS)}
REASON_CODES = {name: code for code, name in enumerate(REASONS)}
OUTCOME_CODES = {name: code for code, name in enumerate(OUTCOMES)}
Value = str | int | float | None
Found = Iterable[tuple[float, float, Mapping[str, Any]]]  # longitude, latitude, degrees; columns


class Record(NamedTuple):
    """A plant of a file: `values` has the columns in their order."""

    lon_deg: float
    lat_deg: float
    values: tuple[Value, ...]


def count_plants(table: PlantTable) -> int:
    """Count the plants, those that several maps have once."""
    return int(table.rows["group"].max()) + 1 if len(table.rows) else 0


def iterate_records(table: PlantTable) -> Iterator[list[Record]]:
    """Make the records of a map in pieces of some thousands."""
    fused, evidence = fuse(table), _Evidence(table)
    for begin in range(0, len(fused.rows), CHUNK):
        yield _make_records(fused, fused.rows[begin : begin + CHUNK], evidence)


def _make_records(table: PlantTable, rows: Rows, evidence: _Evidence) -> list[Record]:
    frame, xy_m = table.frame, np.column_stack([rows["x_map_m"], rows["y_map_m"]])
    places = np.round(frame.lonlat_from_map(xy_m), DEGREE_DECIMALS)
    xy_m = frame.map_from_lonlat(places)  # place after rounding: a file read back is the same
    columns: dict[str, list[Any]] = {
        "id": (
            rows["group"] + 1 if table.is_merged or len(table.maps) > 1 else rows["id"]
        ).tolist(),
        "class": [CLASSES[PlantClass(code)] for code in rows["plant"].tolist()],
        "decision": [DECISIONS[code] or None for code in rows["decision"].tolist()],
        "outcome": [OUTCOMES[code] or None for code in rows["outcome"].tolist()],
        "reason": [REASONS[code] or None for code in rows["reason"].tolist()],
        "std_m": np.round(compute_std_m(rows), _DECIMALS["std_m"]).tolist(),
        "map": [table.maps[code] for code in rows["map"].tolist()],
        "map_id": rows["id"].tolist(),
        "sightings": rows["sightings"].tolist(),
        **{name: _round_known(rows[name], name) for name in ROW_DECIMALS},
        "x_map_m": _round_known(xy_m[:, 0], "x_map_m"),
        "y_map_m": _round_known(xy_m[:, 1], "y_map_m"),
    }
    found = [evidence.find(group) for group in rows["group"].tolist()]
    columns["maps"] = [count for count, _ in found]
    columns["evidence"] = [text for _, text in found]
    values = zip(*(columns[name] for name in COLUMNS), strict=True)
    return [
        Record(place[0], place[1], row) for place, row in zip(places.tolist(), values, strict=True)
    ]


def _round_known(values: FloatArray, name: str) -> list[float | None]:
    rounded = np.round(values, _DECIMALS[name]).tolist()
    if np.isfinite(values).all():
        return list(rounded)
    return [value if math.isfinite(value) else None for value in rounded]


class _Evidence:
    """The rows of the groups that have several, as text: how often, and what each map says."""

    def __init__(self, table: PlantTable) -> None:
        self._table = table
        groups = table.rows["group"]
        self._order = np.argsort(groups, kind="stable") if table.is_merged else None
        if self._order is not None:
            self._begin = np.searchsorted(groups[self._order], np.arange(count_plants(table) + 1))

    def find(self, group: int) -> tuple[int, str | None]:
        if self._order is None:
            return 1, None
        members = self._order[self._begin[group] : self._begin[group + 1]]
        if len(members) < 2:
            return 1, None
        rows = self._table.rows[members]
        alone = self._table._replace(rows=rows.copy())
        alone.rows["group"] = np.arange(len(rows))
        said = [
            {
                "lon": record.lon_deg,
                "lat": record.lat_deg,
                **{
                    name: value
                    for name, value in zip(COLUMNS, record.values, strict=True)
                    if value is not None and name not in _NO_EVIDENCE
                },
            }
            for record in _make_records(alone, alone.rows, _NONE)
        ]
        return len(said), msgspec.json.encode(said).decode()


_NO_EVIDENCE = {"id", "std_m", "x_map_m", "y_map_m", "maps", "evidence"}
_NONE = _Evidence(PlantTable(Datum(lat_deg=0.0, lon_deg=0.0), (), np.empty(0, ROW)))
