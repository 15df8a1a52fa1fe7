"""GeoPackage (OGC 12-128), which is SQLite: one layer for each of areas, lines and points."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing

from agribot.core.sqlite_file import expects_log, limit_work, settle_log
from agribot.gis.geojson import Feature, Found, describe_left_out, split_layers

WGS84_SRS = 4326
UNDEFINED_SRS = {0, -1}
APPLICATION_ID = int.from_bytes(b"GPKG", "big")
VERSION = 10300
# Steps of SQLite's virtual machine: a view may be a program that never ends.
_MAX_STEPS = 50_000_000

# Clause 1.1.2 and table 1 of the standard, and the definition of WGS 84 by EPSG.
TABLES = """
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY,
  organization TEXT NOT NULL, organization_coordsys_id INTEGER NOT NULL,
  definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL,
  identifier TEXT UNIQUE, description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER);
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL,
  geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL,
  m TINYINT NOT NULL, PRIMARY KEY (table_name, column_name));
INSERT INTO gpkg_spatial_ref_sys VALUES
  ('Undefined cartesian SRS', -1, 'NONE', -1, 'undefined', NULL),
  ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', NULL),
  ('WGS 84', 4326, 'EPSG', 4326, 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,'
    || '298.257223563,AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,'
    || 'AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],'
    || 'AUTHORITY["EPSG","4326"]]', NULL);
"""


def read_geopackage(data: bytes) -> Found:
    from shapely import wkb
    from shapely.geometry import mapping

    if expects_log(data):
        yield describe_left_out("what a -wal file beside it holds; close it in QGIS first")
    with closing(_open_database(data)) as database:
        tables = _list_layers(database, is_alone=expects_log(data))
        for table, column, srs in tables:
            if srs != WGS84_SRS and srs not in UNDEFINED_SRS:
                raise ValueError(f"layer '{table}' is in EPSG:{srs}; convert it to EPSG:4326 first")
            cursor = database.execute(f"SELECT * FROM {quote_name(table)}")
            columns = [entry[0] for entry in cursor.description]
            for row in cursor:
                values = dict(zip(columns, row, strict=True))
                blob = values.pop(column)
                if blob is None:
                    yield describe_left_out(f"a row of layer '{table[:40]}' without a place")
                else:
                    shape = wkb.loads(extract_wkb(blob))
                    plain = {k: v for k, v in values.items() if isinstance(v, str | int | float)}
                    yield dict(mapping(shape)), plain


def _list_layers(database: sqlite3.Connection, *, is_alone: bool) -> list[tuple[str, str, int]]:
    """List tables, their columns of geometries and reference systems.

    Raises: ValueError: all of it stands in a log that is not there. sqlite3.Error: no GeoPackage.
    """
    try:
        return database.execute(
            "SELECT table_name, column_name, srs_id FROM gpkg_geometry_columns"
        ).fetchall()
    except sqlite3.OperationalError as error:
        if not is_alone:
            raise
        raise ValueError(
            f"{error}: its content stands in a -wal file that is not beside it; close it in the "
            "program that wrote it, and copy it again"
        ) from error


def _open_database(data: bytes) -> sqlite3.Connection:
    database = sqlite3.connect(":memory:")
    database.deserialize(settle_log(data))
    limit_work(database, _MAX_STEPS)
    return database


def quote_name(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def extract_wkb(blob: bytes) -> bytes:
    """Return the geometry behind a GeoPackage header (OGC 12-128, 2.1.3)."""
    if blob[:2] != b"GP":
        raise ValueError("a geometry is not in GeoPackage's format")
    envelope = (0, 32, 48, 48, 64)[(blob[3] >> 1) & 0b111]
    return blob[8 + envelope :]


def write_geopackage(features: Sequence[Feature]) -> bytes:
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(TABLES)
        database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {VERSION}")
        for geometry, layer, found in split_layers(features):
            _write_layer(database, geometry, layer, found)
        database.commit()
        return database.serialize()


def _write_layer(
    database: sqlite3.Connection, geometry: str, layer: str, features: Sequence[Feature]
) -> None:
    from shapely import get_coordinates, wkb

    shapes = [feature.to_shape() for feature in features]
    coordinates = get_coordinates(shapes)
    bounds = (*map(float, coordinates.min(axis=0)), *map(float, coordinates.max(axis=0)))
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, max_y,"
        " srs_id) VALUES (?, 'features', ?, ?, ?, ?, ?, ?)",
        (layer, layer, *bounds, WGS84_SRS),
    )
    database.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, 0, 0)",
        (layer, geometry.upper(), WGS84_SRS),
    )
    database.execute(
        f"CREATE TABLE {layer} (fid INTEGER PRIMARY KEY, geom {geometry.upper()}, "
        "kind TEXT, name TEXT)"
    )
    head = b"GP\x00\x01" + WGS84_SRS.to_bytes(4, "little")  # version 1, little-endian, no envelope
    rows = [
        (head + wkb.dumps(shape, byte_order=1), feature.kind, feature.name)
        for shape, feature in zip(shapes, features, strict=True)
    ]
    database.executemany(f"INSERT INTO {layer} (geom, kind, name) VALUES (?, ?, ?)", rows)
