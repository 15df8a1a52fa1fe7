"""GeoPackages as QGIS and QField leave them, with a write-ahead log."""

from __future__ import annotations

import json
import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from shapely import wkb
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from agribot.app.prescribed_zones import read_prescription_file
from agribot.cli.main import main
from agribot.core.config import load
from agribot.core.errors import MissionError
from agribot.gis.formats.geopackage import TABLES, WGS84_SRS
from agribot.gis.formats.table import read_field_file

FIELD = Polygon([(11.6, 48.2), (11.6008, 48.2), (11.6008, 48.2004), (11.6, 48.2004)])
PLANTS = [Point(11.6 + number * 3e-5, 48.2001) for number in range(6)]


@contextmanager
def _keep_open(path: Path, kind: str, shapes: list[BaseGeometry]) -> Iterator[None]:
    """Write shapes into the log of a GeoPackage and keep it open meanwhile."""
    with closing(sqlite3.connect(path)) as database:
        database.executescript(TABLES)
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id)"
            " VALUES ('layer', 'features', 'layer', 4326)"
        )
        database.execute(
            "INSERT INTO gpkg_geometry_columns VALUES ('layer', 'geom', ?, 4326, 0, 0)", (kind,)
        )
        database.execute("CREATE TABLE layer (fid INTEGER PRIMARY KEY, geom BLOB)")
        database.commit()
        database.execute("PRAGMA journal_mode = WAL")
        head = b"GP\x00\x01" + struct.pack("<i", WGS84_SRS)
        rows = [(head + wkb.dumps(shape, byte_order=1),) for shape in shapes]
        database.executemany("INSERT INTO layer (geom) VALUES (?)", rows)
        database.commit()
        yield


@pytest.mark.parametrize("is_open", [True, False])
def test_plants_in_a_log_are_imported(is_open: bool, tmp_path: Path) -> None:
    path, target = tmp_path / "weeds.gpkg", tmp_path / "weeds.geojson"
    with _keep_open(path, "POINT", list(PLANTS)):
        if not is_open:
            (tmp_path / "left").mkdir()
            for ending in ("", "-wal"):
                shutil.copyfile(f"{path}{ending}", tmp_path / "left" / f"weeds.gpkg{ending}")
            path = tmp_path / "left" / "weeds.gpkg"
        assert main(["weeds", "import", str(path), "-o", str(target)]) == 0
    assert len(json.loads(target.read_text())["features"]) == 6


@pytest.mark.parametrize("is_open", [True, False])
def test_a_field_with_a_log_is_read_while_it_is_open_and_after_it_was_closed(
    is_open: bool, tmp_path: Path
) -> None:
    path, target = tmp_path / "field.gpkg", tmp_path / "field.geojson"
    with _keep_open(path, "POLYGON", [FIELD]):
        if is_open:
            assert main(["plan", "convert", str(path), "--out", str(target)]) == 0
    if not is_open:
        assert main(["plan", "convert", str(path), "--out", str(target)]) == 0
    (feature,) = json.loads(target.read_text())["features"]
    assert feature["geometry"]["coordinates"][0][0] == pytest.approx([11.6, 48.2])


def test_a_file_that_comes_alone_is_read_and_what_may_be_missing_is_named(tmp_path: Path) -> None:
    """As the page gets it, without what lies beside it."""
    path = tmp_path / "field.gpkg"
    with _keep_open(path, "POLYGON", [FIELD]):
        pass
    collection = read_field_file("field.gpkg", path.read_bytes())
    assert len(collection["features"]) == 1
    assert "-wal file" in collection["left_out"]


def test_a_file_whose_whole_content_stands_in_a_log_that_is_missing_is_refused(
    tmp_path: Path,
) -> None:
    with closing(sqlite3.connect(tmp_path / "field.gpkg")) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.executescript(TABLES)
        alone = (tmp_path / "field.gpkg").read_bytes()
    with pytest.raises(MissionError, match=r"-wal file that is not beside it; close it"):
        read_field_file("field.gpkg", alone)


def test_zones_in_a_log_are_prescribed(tmp_path: Path) -> None:
    path = tmp_path / "zones.gpkg"
    with _keep_open(path, "POLYGON", [FIELD]):
        config = load("farm", [f'treatment.prescription="{path}"'])
        data = read_prescription_file(config)
    assert len(read_field_file("zones.gpkg", data)["features"]) == 1
