"""Waypoint lists as people exchange them: GeoJSON and CSV."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from typing import Any

from agribot.core.errors import MissionError
from agribot.core.facts import (
    AtNullIsland,
    CsvBroken,
    GeometryUnfit,
    HeaderMissing,
    JsonBroken,
    LatitudeOutside,
    ListMissing,
    LongitudeOutside,
    ManyWaypoints,
    NotDegrees,
    NotGeojson,
    NotPosition,
    NotPositions,
    NoWaypointsIn,
    ValuesMissing,
)
from agribot.core.geo import is_nowhere
from agribot.core.geometries import split_geometry
from agribot.core.json_number import quote_value
from agribot.core.table_text import find_separator, names_separator, read_decimal

LatLon = tuple[float, float]
LAT_NAMES = ("lat", "latitude", "lat_deg")
MAX_WAYPOINTS = 10_000  # planned in about half a second; days of driving for a field robot
LON_NAMES = ("lon", "lng", "long", "longitude", "lon_deg")


def parse_waypoints(text: str, source_name: str) -> tuple[LatLon, ...]:
    """Read latitude and longitude in degrees, in file order.

    GeoJSON: Point, MultiPoint and LineString, bare, as features or collected. CSV: a header
    with `lat` and `lon`, in any column; commas, semicolons or tabs between the values, and a comma
    for the decimal point where commas do not separate them.
    Raises: MissionError: names the file, the line or feature, and what is wrong with it.
    """
    text = text.removeprefix("\ufeff")
    found: list[LatLon] = []
    read = _read_geojson if text.lstrip().startswith(("{", "[")) else _read_csv
    try:
        for point, where in read(text, source_name):
            found.append(_check(point, where))
            if len(found) > MAX_WAYPOINTS:
                raise MissionError(ManyWaypoints(source_name, MAX_WAYPOINTS))
    except csv.Error as error:
        raise MissionError(CsvBroken(source_name, str(error))) from error
    if not found:
        raise MissionError(NoWaypointsIn(source_name))
    return tuple(found)


def _check(point: tuple[object, object], where: str) -> LatLon:
    lat_deg, lon_deg = (_read_number(value, where) for value in point)
    if not abs(lat_deg) <= 90.0:
        raise MissionError(LatitudeOutside(where, lat_deg))
    if not abs(lon_deg) <= 180.0:
        raise MissionError(LongitudeOutside(where, lon_deg))
    if is_nowhere(lat_deg, lon_deg):
        raise MissionError(AtNullIsland(where))
    return lat_deg, lon_deg


def _read_number(value: object, where: str) -> float:
    if isinstance(value, int | float | str) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            number = math.nan
        if math.isfinite(number):
            return number
    raise MissionError(NotDegrees(where, quote_value(value)))


def _read_csv(text: str, source_name: str) -> Iterator[tuple[tuple[object, object], str]]:
    lines = text.splitlines()
    separator = find_separator(lines[0] if lines else "")
    skipped = int(bool(lines) and names_separator(lines[0]))
    reader = csv.reader(lines[skipped:], delimiter=separator)
    header = [name.strip().lower() for name in next(reader, [])]
    columns = [
        next((header.index(name) for name in names if name in header), None)
        for names in (LAT_NAMES, LON_NAMES)
    ]
    lat_column, lon_column = columns
    if lat_column is None or lon_column is None:
        raise MissionError(HeaderMissing(source_name, separator.join(header)))
    for fields in reader:
        where = f"{source_name} line {reader.line_num + skipped}"
        if not any(field.strip() for field in fields):
            continue
        if len(fields) <= max(lat_column, lon_column):
            raise MissionError(ValuesMissing(where, len(fields), len(header)))
        values = (fields[lat_column], fields[lon_column])
        lat_deg, lon_deg = (_read_cell(value, separator, where) for value in values)
        yield (lat_deg, lon_deg), where


def _read_cell(text: str, separator: str, where: str) -> float:
    try:
        number = read_decimal(text, separator)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        has_comma = separator == "," and "," in text
        raise MissionError(NotDegrees(where, quote_value(text), has_comma))
    return number


def _read_geojson(text: str, source_name: str) -> Iterator[tuple[tuple[object, object], str]]:
    try:
        root = json.loads(text)
    except (ValueError, RecursionError) as error:  # also a number of thousands of digits
        line = error.lineno if isinstance(error, json.JSONDecodeError) else 0
        raise MissionError(JsonBroken(source_name, str(error), line)) from error
    for geometry, where in _list_geometries(root, source_name):
        yield from _list_positions(geometry, where)


def _list_geometries(node: object, where: str) -> Iterator[tuple[dict[str, object], str]]:
    if not isinstance(node, dict):
        raise MissionError(NotGeojson(where, type(node).__name__))
    kind = node.get("type")
    if kind == "FeatureCollection":
        features = node.get("features")
        if not isinstance(features, list):
            raise MissionError(ListMissing(where, "FeatureCollection", "features"))
        for number, feature in enumerate(features):
            yield from _list_geometries(feature, f"{where} feature {number}")
    elif kind == "Feature":
        if node.get("geometry") is not None:  # a record without a place, as of QGIS
            yield from _list_geometries(node["geometry"], where)
    elif kind == "MultiLineString" and _has_one_part(node):
        yield next(split_geometry(node)), where
    else:
        yield node, where


def _has_one_part(geometry: dict[str, Any]) -> bool:
    parts = geometry.get("coordinates")
    return isinstance(parts, list) and len(parts) == 1


def _list_positions(
    geometry: dict[str, object], where: str
) -> Iterator[tuple[tuple[object, object], str]]:
    kind, coordinates = geometry.get("type"), geometry.get("coordinates")
    if kind == "Point":
        coordinates = [coordinates]
    elif kind not in ("LineString", "MultiPoint"):
        raise MissionError(GeometryUnfit(where, quote_value(kind), "waypoints"))
    if not isinstance(coordinates, list):
        raise MissionError(NotPositions(where))
    for number, position in enumerate(coordinates):
        at = where if kind == "Point" else f"{where} position {number}"
        if not isinstance(position, list) or len(position) < 2:
            raise MissionError(NotPosition(at, quote_value(position)))
        yield (position[1], position[0]), at
