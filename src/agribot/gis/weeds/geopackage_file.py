"""Weed maps as GeoPackage (OGC 12-128), streamed through SQLite, their style for QGIS inside."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from agribot.autonomy.weeds.plant_table import PlantTable
from agribot.core.sqlite_file import limit_work, open_sqlite
from agribot.gis.formats.geopackage import (
    APPLICATION_ID,
    TABLES,
    UNDEFINED_SRS,
    VERSION,
    WGS84_SRS,
    extract_wkb,
    quote_name,
)
from agribot.gis.weeds.found_plants import Reading
from agribot.gis.weeds.records import COLUMNS, Record, iterate_records
from agribot.gis.weeds.styles import make_qgis_style

LAYER = "weed_map"
_MAX_STEPS = 500_000_000  # steps of SQLite's virtual machine; a million plants take a tenth
_MAX_VALUE_BYTES = 10_000_000
_POINT, _MULTIPOINT = 1, 4  # kinds of geometries in well-known binary
# Version 1, little-endian, no envelope, WGS-84; then a little-endian WKB point.
_HEAD = b"GP\x00\x01" + WGS84_SRS.to_bytes(4, "little") + b"\x01\x01\x00\x00\x00"
_COLUMN_TEXT = ", ".join(f'"{name}" {kind}' for name, kind in COLUMNS.items())
# Table that QGIS makes when it saves a style in a database.
_STYLE_TABLE = """
CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT, f_table_catalog TEXT(256),
  f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256),
  styleName TEXT(30), styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT,
  owner TEXT(30), ui TEXT(30),
  update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')));
INSERT INTO gpkg_contents (table_name, data_type, identifier) VALUES
  ('layer_styles', 'attributes', 'layer_styles');
"""


def write_geopackage(path: Path, table: PlantTable) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = OFF")  # a file that was cut off is not put in place
        database.execute("PRAGMA synchronous = OFF")
        database.executescript(TABLES)
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {VERSION}")
        database.execute(
            f"CREATE TABLE {LAYER} (fid INTEGER PRIMARY KEY, geom POINT, {_COLUMN_TEXT})"
        )
        marks = ", ".join("?" * (len(COLUMNS) + 1))
        names = ", ".join(f'"{name}"' for name in COLUMNS)
        insert = f"INSERT INTO {LAYER} (geom, {names}) VALUES ({marks})"
        bounds = [180.0, 90.0, -180.0, -90.0]
        for records in iterate_records(table):
            database.executemany(insert, [(_encode_place(r), *r.values) for r in records])
            _widen(bounds, records)
        _register(database, bounds if len(table.rows) else [None] * 4)
        database.commit()


def _encode_place(record: Record) -> bytes:
    return _HEAD + struct.pack("<dd", record.lon_deg, record.lat_deg)


def _widen(bounds: list[float], records: list[Record]) -> None:
    lon_deg, lat_deg = [r.lon_deg for r in records], [r.lat_deg for r in records]
    bounds[:2] = min(bounds[0], *lon_deg), min(bounds[1], *lat_deg)
    bounds[2:] = max(bounds[2], *lon_deg), max(bounds[3], *lat_deg)


def _register(database: sqlite3.Connection, bounds: list[Any]) -> None:
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, max_y,"
        " srs_id) VALUES (?, 'features', 'Weed map', ?, ?, ?, ?, ?)",
        (LAYER, *bounds, WGS84_SRS),
    )
    database.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'POINT', ?, 0, 0)",
        (LAYER, WGS84_SRS),
    )
    database.executescript(_STYLE_TABLE)
    database.execute(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name,"
        " f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description)"
        " VALUES ('', '', ?, 'geom', 'weed map', ?, '', 1, 'class, decision and outcome')",
        (LAYER, make_qgis_style()),
    )


def read_geopackage(path: Path) -> Reading:
    """Read the layer of points; of several, the one that is named like ours.

    Raises: ValueError: no GeoPackage, no such layer, or one in other coordinates.
    """
    return Reading(_iterate_rows(path))


def _iterate_rows(path: Path) -> Iterator[tuple[float, float, dict[str, Any]]]:
    try:
        with open_sqlite(path) as database:
            limit_work(database, _MAX_STEPS)
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MAX_VALUE_BYTES)
            layer, column = _find_layer(database)
            cursor = database.execute(f"SELECT * FROM {quote_name(layer)}")
            names = [entry[0] for entry in cursor.description]
            at = names.index(column)
            for row in cursor:
                if row[at] is not None:
                    yield *_decode_place(row[at]), dict(zip(names, row, strict=True))
    except sqlite3.Error as error:
        raise ValueError(f"no GeoPackage, or cut off: {error}") from error


def _find_layer(database: sqlite3.Connection) -> tuple[str, str]:
    layers = database.execute(
        "SELECT table_name, column_name, srs_id, geometry_type_name FROM gpkg_geometry_columns"
    ).fetchall()
    points = [layer for layer in layers if layer[3].upper() in {"POINT", "MULTIPOINT", "GEOMETRY"}]
    own = [layer for layer in points if layer[0] == LAYER]
    if len(own or points) != 1:
        names = ", ".join(layer[0] for layer in layers)[:100] or "none"
        raise ValueError(f"one layer of points is wanted; it has: {names}")
    name, column, srs, _ = (own or points)[0]
    if srs != WGS84_SRS and srs not in UNDEFINED_SRS:
        raise ValueError(f"layer '{name}' is in EPSG:{srs}; convert it to EPSG:4326 first")
    return name, column


def _decode_place(blob: bytes) -> tuple[float, float]:
    """Read a point, or the one of a multipoint, of well-known binary (OGC 06-103r4, clause 8)."""
    place = extract_wkb(blob)
    kind, count = _read_head(place)
    if kind == _MULTIPOINT and count == 1:
        place = place[9:]
        kind, _ = _read_head(place)
    if len(place) < 21 or kind != _POINT:
        raise ValueError("a plant is a Point, and a geometry is not")
    lon_deg, lat_deg = struct.unpack(_find_order(place) + "dd", place[5:21])
    return lon_deg, lat_deg


def _read_head(place: bytes) -> tuple[int, int]:
    """Read the kind of a geometry and the number behind it: of a multipoint, of its points."""
    if len(place) < 9:
        return 0, 0
    kind, count = struct.unpack(_find_order(place) + "II", place[1:9])
    return kind % 1000, count


def _find_order(place: bytes) -> str:
    return "<" if place[:1] == b"\x01" else ">"
