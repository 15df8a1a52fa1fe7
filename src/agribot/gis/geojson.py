"""GeoJSON (RFC 7946): features with checked positions."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from agribot.core.errors import MissionError
from agribot.core.facts import (
    AtNullIsland,
    FileBroken,
    FileUnreadable,
    GeometryMissing,
    GeometryUnfit,
    LatLonSwapped,
    ListMissing,
    ManyPoints,
    NotDegrees,
    NotGeojson,
    NotLonLat,
    NotPosition,
    NotPositions,
    OtherCoordinates,
)
from agribot.core.geo import is_nowhere
from agribot.core.json_number import is_number, quote_value
from agribot.core.table_text import decode_text, read_text_file

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

LonLat = tuple[float, float]
Geometry = dict[str, Any]
# Geometry and properties of each feature, or None and what was left out (`describe_left_out`).
Found = Iterator[tuple[Geometry | None, dict[str, Any]]]
KINDS = ("boundary", "obstacle", "row", "crop", "ab_line", "waypoint")
MAX_POINTS = 20_000


def make_feature(geometry: str, coordinates: object, **properties: object) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": geometry, "coordinates": coordinates},
    }


def describe_left_out(what: str) -> tuple[None, dict[str, Any]]:
    """Say in a few words what a reader found in a file and does not give back."""
    return None, {"left_out": what}


class Feature(NamedTuple):
    """A shape with its kind; `parts` are the rings of a polygon, or one list of positions."""

    where: str
    kind: str
    geometry: str
    parts: list[list[LonLat]]
    properties: dict[str, Any]

    @property
    def name(self) -> str:
        """The feature's name; empty without one."""
        return str(self.properties.get("name") or "")

    def nest_coordinates(self) -> Any:
        """Nest the positions as GeoJSON does."""
        if self.geometry == "Polygon":
            return self.parts
        return self.parts[0] if self.geometry == "LineString" else self.parts[0][0]

    def to_shape(self) -> BaseGeometry:
        """Convert to a shape of longitude and latitude, degrees."""
        from shapely.geometry import shape

        return shape({"type": self.geometry, "coordinates": self.nest_coordinates()})


def split_layers(features: Sequence[Feature]) -> Iterator[tuple[str, str, list[Feature]]]:
    """Yield geometry, name and features of each layer, for formats with one geometry a layer."""
    for geometry, name in (("Polygon", "areas"), ("LineString", "lines"), ("Point", "points")):
        found = [feature for feature in features if feature.geometry == geometry]
        if found:
            yield geometry, name, found


def close_ring(ring: list[LonLat]) -> list[LonLat]:
    """Repeat a ring's first position at its end, as GeoJSON requires."""
    return ring if ring[:1] == ring[-1:] else [*ring, ring[0]]


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises: MissionError: the file is missing or is not JSON.
    """
    try:
        text = read_text_file(path)
    except (OSError, ValueError) as error:
        raise MissionError(FileUnreadable(str(path), str(error))) from error
    try:
        return parse_json(text)
    except ValueError as error:
        raise MissionError(FileBroken(path.name, str(error))) from error


def parse_json(text: str) -> Any:
    """Parse JSON.

    Raises: ValueError: not JSON, with the line.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # also a number of thousands of digits
        place = f"line {error.lineno}" if isinstance(error, json.JSONDecodeError) else "it"
        raise ValueError(f"{place} is not valid JSON: {error}") from error


def read_geojson(data: bytes) -> Found:
    """Read the geometries of a file as they are: of any kind, with heights, or without a place.

    Raises: ValueError: no GeoJSON, or in other coordinates.
    """
    root = parse_json(decode_text(data))
    other = find_other_crs(root.get("crs")) if isinstance(root, dict) else ""
    if other:
        raise ValueError(f"its coordinates are in {other}; convert it to WGS-84 (EPSG:4326) first")
    yield from _iterate_members(root, "the file")


def _iterate_members(root: object, where: str) -> Found:
    node = need_object(root, where)
    if node.get("type") == "FeatureCollection":
        for number, member in enumerate(need_members(node, "features", where)):
            yield from _iterate_members(member, f"feature {number}")
        return
    is_feature = node.get("type") == "Feature"
    geometry, properties = (
        (node.get("geometry"), node.get("properties")) if is_feature else (node, {})
    )
    if geometry is None:
        yield describe_left_out("a feature without a place")
    else:
        yield geometry, dict(properties or {})


def find_other_crs(crs: object) -> str:
    """Find the name of a coordinate system that is not WGS-84 in a member `crs` of GeoJSON.

    Empty for WGS-84, or if the member names none.
    """
    crs_name = crs.get("properties") if isinstance(crs, dict) else None
    name = (crs_name.get("name") or crs_name.get("href")) if isinstance(crs_name, dict) else crs
    return "" if not name or str(name).endswith(("CRS84", "4326")) else str(name)[:100]


def parse_features(root: object, source_name: str) -> list[Feature]:
    """Parse all features below a GeoJSON object.

    Raises: MissionError: names the feature and the position that is wrong, or other coordinates.
    """
    other = find_other_crs(root.get("crs")) if isinstance(root, dict) else ""
    if other:
        raise MissionError(OtherCoordinates(source_name, other))
    found = list(_iterate_features(root, source_name))
    points = sum(len(part) for feature in found for part in feature.parts)
    if points > MAX_POINTS:
        raise MissionError(ManyPoints(source_name, points, MAX_POINTS))
    return found


def need_object(node: object, where: str) -> dict[str, Any]:
    """Return `node`, which has to be a GeoJSON object.

    Raises: MissionError: it is another type.
    """
    if not isinstance(node, dict):
        raise MissionError(NotGeojson(where, type(node).__name__))
    return node


def need_members(node: dict[str, Any], name: str, where: str) -> Sequence[Any]:
    """Return the list `name` of a GeoJSON object.

    Raises: MissionError: it has none.
    """
    members = node.get(name)
    if not isinstance(members, list | tuple):
        raise MissionError(ListMissing(where, str(node.get("type")), name))
    return members


def _iterate_features(root: object, where: str) -> Iterator[Feature]:
    node: Any = need_object(root, where)
    if node.get("type") == "FeatureCollection":
        for number, member in enumerate(need_members(node, "features", where)):
            yield from _iterate_features(member, f"{where} feature {number}")
        return
    properties: dict[str, Any] = {}
    if node.get("type") == "Feature":
        properties = node.get("properties") or {}
        node = node.get("geometry")
    if not isinstance(node, dict) or not isinstance(properties, dict):
        raise MissionError(GeometryMissing(where))
    kind = str(properties.get("kind") or "")
    yield Feature(where, kind, str(node.get("type")), _read_parts(node, where), properties)


def _read_parts(geometry: dict[str, Any], where: str) -> list[list[LonLat]]:
    name, coordinates = geometry.get("type"), geometry.get("coordinates")
    if name == "Point":
        return [[read_position(coordinates, where)]]
    if name == "LineString":
        return [_read_positions(coordinates, where)]
    if name == "Polygon" and isinstance(coordinates, list) and coordinates:
        return [
            _read_positions(ring, f"{where} ring {number}")
            for number, ring in enumerate(coordinates)
        ]
    raise MissionError(GeometryUnfit(where, quote_value(name), "field"))


def _read_positions(coordinates: object, where: str) -> list[LonLat]:
    if not isinstance(coordinates, list) or not coordinates:
        raise MissionError(NotPositions(where))
    return [
        read_position(item, f"{where} position {number}") for number, item in enumerate(coordinates)
    ]


def read_position(position: object, where: str) -> LonLat:
    """Read longitude and latitude, degrees.

    Raises: MissionError: no longitude and latitude in degrees.
    """
    if not isinstance(position, list | tuple) or len(position) < 2:
        raise MissionError(NotPosition(where, quote_value(position)))
    lon_deg, lat_deg = (_read_degrees(value, where) for value in position[:2])
    if abs(lat_deg) > 90.0 >= abs(lon_deg):
        raise MissionError(LatLonSwapped(where, lat_deg, f"[{lat_deg}, {lon_deg}]"))
    if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
        raise MissionError(NotLonLat(where, f"[{lon_deg}, {lat_deg}]"))
    if is_nowhere(lat_deg, lon_deg):
        raise MissionError(AtNullIsland(where))
    return lon_deg, lat_deg


def _read_degrees(value: object, where: str) -> float:
    if not is_number(value):
        raise MissionError(NotDegrees(where, quote_value(value)))
    return float(value)
