"""Field files of other programs as GeoJSON: GeoJSON, KML, KMZ, GeoPackage, zipped Shapefile."""

from __future__ import annotations

import io
import sqlite3
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import PurePath
from typing import Any

import msgspec

from agribot.ui.answers import Unusable

MAX_UNPACKED_BYTES = 100_000_000
WGS84_SRS = 4326
_KIND_OF = {"Polygon": "boundary", "LineString": "row", "Point": "waypoint"}

Geometry = dict[str, Any]
Found = Iterator[tuple[Geometry, dict[str, Any]]]


def read_field_file(name: str, data: bytes) -> dict[str, Any]:
    """A FeatureCollection in WGS-84; features without a `kind` get the usual one of their shape.

    Raises: Unusable: an unknown kind of file, a broken one, or one in another coordinate system.
    """
    reader = READERS.get(PurePath(name).suffix.lower())
    if reader is None:
        known = ", ".join(sorted(READERS))
        raise Unusable(415, f"'{name[:80]}': files that can be read end with {known}")
    try:
        features = [
            feature
            for geometry, properties in reader(data)
            for feature in _single(geometry, properties)
        ]
    except (
        ET.ParseError,
        sqlite3.Error,
        zipfile.BadZipFile,
        msgspec.MsgspecError,
        ValueError,
        KeyError,
        TypeError,
        IndexError,
        AttributeError,
    ) as error:
        raise Unusable(422, f"'{name[:80]}' cannot be read: {error}") from error
    if not features:
        raise Unusable(422, f"'{name[:80]}' holds no point, line or polygon")
    return {"type": "FeatureCollection", "features": features}


def _single(geometry: Geometry, properties: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Multi-geometries apart; heights left out."""
    kind = geometry["type"]
    if kind == "GeometryCollection":
        for part in geometry["geometries"]:
            yield from _single(part, properties)
        return
    parts = geometry["coordinates"] if kind.startswith("Multi") else [geometry["coordinates"]]
    single = kind.removeprefix("Multi")
    for part in parts:
        named = dict(properties)
        named.setdefault("kind", _KIND_OF[single])
        shape = {"type": single, "coordinates": _flat(part)}
        yield {"type": "Feature", "geometry": shape, "properties": named}


def _flat(coordinates: Any) -> Any:
    if isinstance(coordinates[0], int | float):
        return [float(coordinates[0]), float(coordinates[1])]
    return [_flat(inner) for inner in coordinates]


def _geojson(data: bytes) -> Found:
    tree = msgspec.json.decode(data)
    crs = ((tree.get("crs") or {}).get("properties") or {}).get("name", "CRS84")
    if not str(crs).endswith(("CRS84", "4326")):
        raise ValueError(f"coordinates are in {crs}; convert them to WGS-84 first")
    kind = tree.get("type")
    if kind == "FeatureCollection":
        features = tree["features"]
    else:
        features = [tree if kind == "Feature" else {"geometry": tree}]
    for feature in features:
        yield feature["geometry"], feature.get("properties") or {}


def _kml(data: bytes) -> Found:
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError("document type declarations are not accepted")
    for mark in ET.fromstring(data).iter():
        if _tag(mark) == "Placemark":
            name = next((e.text for e in mark if _tag(e) == "name" and e.text), None)
            for geometry in _kml_shapes(mark):
                yield geometry, {"name": name} if name else {}


def _kml_shapes(mark: ET.Element) -> Iterator[Geometry]:
    for element in mark.iter():
        kind = _tag(element)
        if kind in {"Point", "LineString"}:
            points = _kml_points(element)
            yield {"type": kind, "coordinates": points[0] if kind == "Point" else points}
        elif kind == "Polygon":
            rings = [ring for ring in element.iter() if _tag(ring) == "LinearRing"]
            yield {"type": "Polygon", "coordinates": [_kml_points(ring) for ring in rings]}


def _kml_points(element: ET.Element) -> list[list[float]]:
    text = next((e.text or "" for e in element.iter() if _tag(e) == "coordinates"), "")
    return [[float(number) for number in point.split(",")[:2]] for point in text.split()]


def _tag(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _kmz(data: bytes) -> Found:
    yield from _kml(_unzipped(data, ".kml"))


def _unzipped(data: bytes, suffix: str) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for entry in archive.infolist():
            if entry.filename.lower().endswith(suffix):
                if entry.file_size > MAX_UNPACKED_BYTES:
                    raise ValueError(f"{entry.filename} unpacks to {entry.file_size} bytes")
                return archive.read(entry)
    raise ValueError(f"no {suffix} file inside")


def _geopackage(data: bytes) -> Found:
    from shapely import wkb
    from shapely.geometry import mapping

    with closing(sqlite3.connect(":memory:")) as database:
        database.deserialize(data)
        tables = database.execute(
            "SELECT table_name, column_name, srs_id FROM gpkg_geometry_columns"
        ).fetchall()
        for table, column, srs in tables:
            if srs not in {WGS84_SRS, 0, -1}:
                raise ValueError(f"layer '{table}' is in EPSG:{srs}; convert it to EPSG:4326 first")
            cursor = database.execute(f"SELECT * FROM {_quoted(table)}")
            columns = [entry[0] for entry in cursor.description]
            for row in cursor:
                values = dict(zip(columns, row, strict=True))
                blob = values.pop(column)
                if blob is not None:
                    shape = wkb.loads(_wkb(blob))
                    plain = {k: v for k, v in values.items() if isinstance(v, str | int | float)}
                    yield dict(mapping(shape)), plain


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _wkb(blob: bytes) -> bytes:
    """The geometry behind a GeoPackage header (OGC 12-128, 2.1.3)."""
    if blob[:2] != b"GP":
        raise ValueError("a geometry is not in GeoPackage's format")
    envelope = (0, 32, 48, 48, 64)[(blob[3] >> 1) & 0b111]
    return blob[8 + envelope :]


def _shapefile(data: bytes) -> Found:
    import shapefile

    parts = {suffix: io.BytesIO(_unzipped(data, f".{suffix}")) for suffix in ("shp", "dbf")}
    try:
        projection = _unzipped(data, ".prj").decode(errors="replace")
    except ValueError:
        projection = ""
    if projection.startswith("PROJCS"):
        raise ValueError("coordinates are projected; convert them to WGS-84 (EPSG:4326) first")
    with shapefile.Reader(**parts) as reader:
        for record in reader.iterShapeRecords():
            names = record.record.as_dict()
            plain = {k: v for k, v in names.items() if isinstance(v, str | int | float)}
            yield dict(record.shape.__geo_interface__), plain


READERS: dict[str, Callable[[bytes], Found]] = {
    ".geojson": _geojson,
    ".json": _geojson,
    ".kml": _kml,
    ".kmz": _kmz,
    ".gpkg": _geopackage,
    ".zip": _shapefile,
}
