"""Which formats there are, and field files of any of them in and out."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path, PurePath
from typing import Any

from agribot.core.errors import AgribotError, MissionError
from agribot.gis.formats.geopackage import read_geopackage, write_geopackage
from agribot.gis.formats.gpx import read_gpx, write_gpx
from agribot.gis.formats.isoxml import holds_task_data, read_isoxml, write_isoxml
from agribot.gis.formats.kml import read_kml, read_kmz, write_kml, write_kmz
from agribot.gis.formats.shapes import read_shapefiles, write_shapefiles
from agribot.gis.formats.untrusted import MAX_FILE_BYTES, member_names
from agribot.gis.geojson import Feature, Found, Geometry, checked_position, features

_KIND_OF = {"LineString": "row", "Point": "waypoint"}


def read_field_file(name: str, data: bytes) -> dict[str, Any]:
    """A FeatureCollection in WGS-84, without heights and multi-geometries.

    A feature without a `kind` gets the usual one: the first polygon is the boundary, others are
    obstacles, lines are rows.
    Raises: MissionError: an unknown kind of file, a broken one, or one in other coordinates.
    """
    shown = f"'{name[:80]}'"
    reader = READERS.get(PurePath(name).suffix.lower())
    if reader is None:
        raise MissionError(f"{shown}: files that can be read end with {', '.join(sorted(READERS))}")
    found: list[dict[str, Any]] = []
    try:
        for geometry, properties in reader(data):
            for shape in _single(geometry, shown):
                found.append({"type": "Feature", "geometry": shape, "properties": {**properties}})
    except AgribotError:
        raise
    except Exception as error:  # each library has its own errors for bytes that make no sense
        reason = " ".join(str(error).split()) or "it is empty or cut off"
        raise MissionError(f"{shown} cannot be read: {reason}") from error
    if not found:
        raise MissionError(f"{shown} holds no point, line or polygon")
    _give_kinds(found)
    return {"type": "FeatureCollection", "features": found}


def read_other(path: Path) -> dict[str, Any]:
    """As `read_field_file`. Raises: MissionError: also where there is no such file."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MissionError(
                f"{path.name} has {path.stat().st_size} bytes, more than {MAX_FILE_BYTES}"
            )
        return read_field_file(path.name, path.read_bytes())
    except OSError as error:
        raise MissionError(f"cannot read {path}: {error}; check the path") from error


def write_field_file(suffix: str, collection: object) -> bytes:
    """Raises: MissionError: no such format, or what a field of GeoJSON must not be."""
    writer = WRITERS.get(suffix)
    if writer is None:
        raise MissionError(f"'{suffix[:20]}': choose one of {', '.join(WRITERS)}")
    return writer(features(collection, "the field"))


def _single(geometry: Geometry, where: str) -> list[Geometry]:
    """Multi-geometries apart; heights left out."""
    kind = geometry["type"]
    if kind == "GeometryCollection":
        return [one for part in geometry["geometries"] for one in _single(part, where)]
    parts = geometry["coordinates"] if kind.startswith("Multi") else [geometry["coordinates"]]
    single = kind.removeprefix("Multi")
    return [{"type": single, "coordinates": _flat(part, where)} for part in parts]


def _flat(coordinates: Any, where: str) -> Any:
    if isinstance(coordinates[0], int | float):
        return list(checked_position(coordinates, where))
    return [_flat(inner, where) for inner in coordinates]


def _give_kinds(found: Sequence[dict[str, Any]]) -> None:
    bounded = any(feature["properties"].get("kind") == "boundary" for feature in found)
    for feature in found:
        shape = feature["geometry"]["type"]
        area = "obstacle" if bounded else "boundary"
        feature["properties"].setdefault("kind", _KIND_OF.get(shape, area))
        bounded = bounded or feature["properties"]["kind"] == "boundary"


def _read_geojson(data: bytes) -> Found:
    tree = json.loads(data)
    crs = ((tree.get("crs") or {}).get("properties") or {}).get("name", "CRS84")
    if not str(crs).endswith(("CRS84", "4326")):
        raise ValueError(f"coordinates are in {crs}; convert them to WGS-84 first")
    kind = tree.get("type")
    if kind == "FeatureCollection":
        members = tree["features"]
    else:
        members = [tree if kind == "Feature" else {"geometry": tree}]
    for member in members:
        yield member["geometry"], member.get("properties") or {}


def _write_geojson(found: Sequence[Feature]) -> bytes:
    written = [
        {
            "type": "Feature",
            "properties": {"kind": f.kind, **({"name": f.name} if f.name else {})},
            "geometry": {"type": f.geometry, "coordinates": f.coordinates()},
        }
        for f in found
    ]
    return json.dumps({"type": "FeatureCollection", "features": written}, indent=1).encode() + b"\n"


def _read_archive(data: bytes) -> Found:
    read = read_isoxml if holds_task_data(member_names(data)) else read_shapefiles
    return read(data)


READERS: dict[str, Callable[[bytes], Found]] = {
    ".geojson": _read_geojson,
    ".json": _read_geojson,
    ".kml": read_kml,
    ".kmz": read_kmz,
    ".gpkg": read_geopackage,
    ".gpx": read_gpx,
    ".zip": _read_archive,
}
# Two of the formats are archives: their endings tell them apart.
WRITERS: dict[str, Callable[[Sequence[Feature]], bytes]] = {
    ".geojson": _write_geojson,
    ".gpkg": write_geopackage,
    ".kml": write_kml,
    ".kmz": write_kmz,
    ".gpx": write_gpx,
    ".shp.zip": write_shapefiles,
    ".isoxml.zip": write_isoxml,
}
