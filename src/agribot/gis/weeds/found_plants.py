"""Check the plants of any file, report what is wrong with them, and make a table of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np

from agribot.autonomy.weeds.plant_table import ROW, PlantTable, Rows, read_column, round_rows
from agribot.core.errors import RecordingError, add_advice
from agribot.core.geo import NOWHERE, Datum, MapFrame
from agribot.core.messages import FloatArray, PlantClass
from agribot.gis.weeds.records import (
    CHUNK,
    CLASSES,
    DECISION_CODES,
    DEFAULT_STD_M,
    MAX_PLANTS,
    OUTCOME_CODES,
    REASON_CODES,
    Found,
)

MAX_EXTENT_M = 20_000.0  # largest extent: a local map is flat only near its origin
MAX_EVIDENCE = 1000
APART_M, APART_RATIO = 0.05, 1e-3  # between a place in degrees and the same in the robot's map
_PLANT_OF = {name: int(plant) for plant, name in CLASSES.items()}
_AXES = {
    "x_map_m and y_map_m are exchanged": ((0, 1), (1, 0)),
    "x_map_m is mirrored: it grows to the West": ((-1, 0), (0, 1)),
    "y_map_m is mirrored: it grows to the South": ((1, 0), (0, -1)),
}


class Reading(NamedTuple):
    """Content of a file: its plants, and the datum of its map if it has one."""

    found: Found
    datum: Datum | None = None


def tabulate_found(
    reading: Reading, shown: str, name: str, classes: Mapping[str, str] | None = None
) -> PlantTable:
    """Make the table of a file's plants; `shown` is the file in errors.

    `name` is the map's name if the file has no name; `classes` says which values of `class` are
    weed and crop.
    Raises: RecordingError: an invalid plant, or places that cannot be those of one field.
    """
    collector = _Collector(shown, name, classes or {})
    for lon_deg, lat_deg, values in reading.found:
        collector.add(lon_deg, lat_deg, values)
    return collector.finish(reading.datum)


class _Collector:
    def __init__(self, shown: str, name: str, classes: Mapping[str, str]) -> None:
        self._shown, self._name = shown, name
        self._plant_of = {**_PLANT_OF, **{key: _PLANT_OF[to] for key, to in classes.items()}}
        self._maps: dict[str, int] = {}
        self._waiting: list[tuple[Any, ...]] = []
        self._parts: list[Rows] = []
        self._xy: list[tuple[float, float]] = []
        self._xy_parts: list[FloatArray] = []
        self._group = 0

    def add(self, lon_deg: float, lat_deg: float, values: Mapping[str, Any]) -> None:
        """Take in a plant, or the plants of several maps that it was merged from."""
        if self._group >= MAX_PLANTS:
            raise RecordingError(f"{self._shown} has more than {MAX_PLANTS} plants; split it")
        try:
            evidence = values.get("evidence")
            if evidence:
                for said in _decode_evidence(evidence):
                    self._append(said["lon"], said["lat"], said)
            elif (values.get("maps") or 1) > 1:
                raise ValueError(
                    "it was merged from several maps, and the file does not hold them; take the "
                    "merged map as GeoJSON, GeoPackage, KML or CSV"
                )
            else:
                self._append(lon_deg, lat_deg, values)
        except (ValueError, TypeError, KeyError, msgspec.MsgspecError) as error:
            fact = f"{self._shown}, plant {self._group + 1}: {_say(error)}"
            raise RecordingError(add_advice(fact, "export it anew")) from error
        self._group += 1
        if len(self._waiting) >= CHUNK:
            self._flush()

    def _append(self, lon_deg: float, lat_deg: float, values: Mapping[str, Any]) -> None:
        take = values.get
        stated = take("id") if take("map_id") is None else take("map_id")
        id = self._group + 1 if stated is None else _read_id(stated)
        xx_m2, xy_m2, yy_m2 = take("xx_m2"), take("xy_m2"), take("yy_m2")
        if xx_m2 is None or yy_m2 is None:
            xx_m2 = yy_m2 = _read_std(take("std_m")) ** 2
        name = take("map") or self._name
        self._waiting.append(
            (
                self._maps.setdefault(str(name), len(self._maps)), id, self._group,
                self._read_class(take("class")), DECISION_CODES[take("decision") or ""],
                OUTCOME_CODES[take("outcome") or ""], REASON_CODES[take("reason") or ""],
                int(take("sightings") or 0), lon_deg, lat_deg, xx_m2, xy_m2 or 0.0, yy_m2,
                _read(take("area_m2")), _read(take("confidence")), _read(take("first_seen_s")),
                _read(take("last_seen_s")), _read(take("treated_s")),
            )
        )  # fmt: skip
        self._xy.append((_read(take("x_map_m")), _read(take("y_map_m"))))

    def _read_class(self, value: object) -> int:
        if value is None:
            return int(PlantClass.WEED)
        known = self._plant_of.get(str(value).lower().removesuffix(".0"))
        if known is None:
            raise ValueError(
                f"class {str(value)[:40]!r} is neither weed nor crop; say what it is with "
                f"--classes {str(value)[:40]}=weed,…"
            )
        return known

    def _flush(self) -> None:
        self._parts.append(np.array(self._waiting, dtype=ROW))
        self._xy_parts.append(np.array(self._xy, dtype=float).reshape(-1, 2))
        self._waiting, self._xy = [], []

    def finish(self, datum: Datum | None) -> PlantTable:
        try:
            self._flush()
        except (ValueError, TypeError, OverflowError) as error:
            fact = f"{self._shown}: {_say(error)}"
            raise RecordingError(add_advice(fact, "export it anew")) from error
        rows, xy_m = np.concatenate(self._parts), np.concatenate(self._xy_parts)
        self._parts.clear()
        lonlat_deg = np.column_stack([rows["x_map_m"], rows["y_map_m"]])
        _check_degrees(lonlat_deg, self._shown)
        _check_numbers(rows, self._shown)
        datum = datum or _find_datum(lonlat_deg, xy_m)
        own_m = MapFrame(datum).map_from_lonlat(lonlat_deg)
        _check_axes(own_m, xy_m, self._shown)
        _check_extent(own_m, datum, self._shown)
        rows["x_map_m"], rows["y_map_m"] = own_m[:, 0], own_m[:, 1]
        maps = tuple(self._maps) or (self._name,)
        table = round_rows(PlantTable(datum, maps, _note_treated(rows)))
        _check_ids(table, self._shown)
        return table


def _note_treated(rows: Rows) -> Rows:
    """Note the treated weeds of a file without outcomes."""
    if rows["outcome"].any():
        return rows
    is_treated = np.isfinite(rows["treated_s"]) & (rows["plant"] == PlantClass.WEED)
    rows["outcome"][is_treated] = OUTCOME_CODES["treated"]
    rows["decision"][is_treated] = DECISION_CODES["treat"]
    return rows


def _say(error: Exception) -> str:
    return f"unknown value or missing column {error}" if isinstance(error, KeyError) else str(error)


def _decode_evidence(text: object) -> Iterator[dict[str, Any]]:
    said = msgspec.json.decode(str(text), type=list[dict[str, Any]])
    if len(said) > MAX_EVIDENCE:
        raise ValueError(f"{len(said)} maps say something of it, more than {MAX_EVIDENCE}")
    yield from said


def _read(value: object) -> float:
    return math.nan if value is None or value == "" else float(value)  # type: ignore[arg-type]


def _read_id(value: Any) -> int:
    try:
        id = int(value)
    except (ValueError, TypeError, OverflowError):
        id = None
    if id is None or (isinstance(value, float) and id != value):
        raise ValueError(
            f"its id {str(value)[:40]!r} is not a whole number; give the column another name, and "
            "plants are numbered"
        )
    return id


def _read_std(value: object) -> float:
    std_m = _read(value)
    return DEFAULT_STD_M if math.isnan(std_m) else std_m


def _check_degrees(lonlat_deg: FloatArray, shown: str) -> None:
    if not np.isfinite(lonlat_deg).all():
        at = int(np.argmin(np.isfinite(lonlat_deg).all(axis=1)))
        raise RecordingError(
            f"{shown}, plant {at + 1}: its place is no number; remove or correct it"
        )
    is_null = (lonlat_deg == 0.0).all(axis=1)
    if is_null.any():
        raise RecordingError(f"{shown}, plant {int(np.argmax(is_null)) + 1}: {NOWHERE}")
    beyond = np.abs(lonlat_deg) > (180.0, 90.0)
    if not beyond.any():
        return
    at = int(np.argmax(beyond.any(axis=1)))
    lon_deg, lat_deg = lonlat_deg[at]
    hint = "its coordinates are not in degrees; convert it to WGS-84 (EPSG:4326) first"
    if (np.abs(lonlat_deg) <= (90.0, 180.0)).all():
        hint = "longitude and latitude are exchanged: longitude comes first"
    fact = f"{shown}, plant {at + 1}: place [{lon_deg:g}, {lat_deg:g}]: {hint}"
    raise RecordingError(add_advice(fact, "exchange them"))


def _check_numbers(rows: Rows, shown: str) -> None:
    xx_m2, xy_m2, yy_m2 = (read_column(rows, name) for name in ("xx_m2", "xy_m2", "yy_m2"))
    confidence = read_column(rows, "confidence")
    wrong = {
        "its covariance is not positive definite": ~(
            (xx_m2 > 0) & (yy_m2 > 0) & (xx_m2 * yy_m2 - xy_m2**2 > 0)
        ),
        "its confidence is not between 0 and 1": (confidence < 0) | (confidence > 1),
        "its area is negative": read_column(rows, "area_m2") < 0,
    }
    for what, is_wrong in wrong.items():
        if is_wrong.any():
            plant = int(np.argmax(is_wrong)) + 1
            raise RecordingError(f"{shown}, plant {plant}: {what}; correct it, or leave it out")


def _find_datum(lonlat_deg: FloatArray, xy_m: FloatArray) -> Datum:
    """Find the origin of the map in which the first plant has its `x_map_m` and `y_map_m`.

    Without these the first plant is the origin.
    """
    if not len(lonlat_deg):
        return Datum(lat_deg=0.0, lon_deg=0.0)
    lon_deg, lat_deg = lonlat_deg[0].tolist()
    if np.isfinite(xy_m[0]).all() and np.abs(xy_m[0]).max() <= MAX_EXTENT_M:
        for _ in range(3):
            frame = MapFrame(Datum(lat_deg=lat_deg, lon_deg=lon_deg))
            gap_m = frame.map_from_lonlat(lonlat_deg[:1]) - xy_m[:1]
            lon_deg, lat_deg = np.round(frame.lonlat_from_map(gap_m)[0], 10).tolist()
    return Datum(lat_deg=lat_deg, lon_deg=lon_deg)


def _check_axes(own_m: FloatArray, xy_m: FloatArray, shown: str) -> None:
    """Hold the places in degrees against those in the robot's map, where a file has both."""
    known = np.isfinite(xy_m).all(axis=1)
    if not known.any():
        return
    own_m, xy_m = own_m[known] - own_m[known][0], xy_m[known] - xy_m[known][0]
    allowed_m = APART_M + APART_RATIO * np.abs(own_m).max()
    gap_m = np.abs(own_m - xy_m).max()
    if gap_m <= allowed_m:
        return
    for what, turn in _AXES.items():
        if np.abs(own_m - xy_m @ np.array(turn)).max() <= allowed_m:
            raise RecordingError(f"{shown}: {what}; export the file again")
    raise RecordingError(
        f"{shown}: its places in degrees and its x_map_m, y_map_m are up to {gap_m:.2f} m apart; "
        "drop these two columns if its geometry is right"
    )


def _check_extent(xy_m: FloatArray, datum: Datum, shown: str) -> None:
    if not len(xy_m):
        return
    away_m = float(np.hypot(xy_m[:, 0], xy_m[:, 1]).max())
    if away_m > MAX_EXTENT_M:
        raise RecordingError(
            f"{shown}: its plants reach {away_m / 1000:.0f} km from latitude {datum.lat_deg:.6f}, "
            f"longitude {datum.lon_deg:.6f}, more than {MAX_EXTENT_M / 1000:.0f} km; it is no map "
            "of one field"
        )


def _check_ids(table: PlantTable, shown: str) -> None:
    rows = table.rows
    order = np.lexsort((rows["id"], rows["map"]))
    ids, maps = rows["id"][order], rows["map"][order]
    twice = (ids[1:] == ids[:-1]) & (maps[1:] == maps[:-1])
    if twice.any():
        at = int(np.argmax(twice))
        raise RecordingError(
            f"{shown}: two plants of map {table.maps[maps[at]]} have the id {ids[at]}; an id "
            "belongs to one plant"
        )
