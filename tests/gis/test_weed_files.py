"""Weed maps in the files of farm software: other programs read them, and nothing broken gets in."""

from __future__ import annotations

import csv
import json
import os
import sqlite3
import subprocess
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapefile
import shapely

from agribot.autonomy.weeds.merge import merge_maps
from agribot.autonomy.weeds.plant_table import (
    DECISIONS,
    OUTCOMES,
    PlantTable,
    is_crop,
    move_to_datum,
)
from agribot.cli.main import main
from agribot.core.errors import RecordingError
from agribot.gis.formats.shapes import WGS84
from agribot.gis.weeds.files import FORMATS, read_map, write_map
from agribot.gis.weeds.found_plants import Reading, tabulate_found
from agribot.gis.weeds.records import COLUMNS, iterate_records
from agribot.gis.weeds.styles import STYLES, find_style
from tests.gis.weed_maps import DATUM, make_map, scatter
from tests.machine import needs

TENTH_MM_M = 1.5e-4
SYSTEM_PYTHON = Path("/usr/bin/python3")
HAS_QGIS = any(Path("/usr/lib").glob("python3/dist-packages/qgis/core/__init__.py"))
MAP = make_map(scatter(500), std_m=0.02)
MERGED = merge_maps([make_map(scatter(200), n, std_m=0.02, seed=s) for s, n in enumerate("ab")])


def written(folder: Path, suffix: str, table: PlantTable = MAP) -> Path:
    path = folder / f"north field{suffix}"
    write_map(path, table)
    return path


def ogr(*words: str) -> str:
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_map_comes_back_from_every_format_as_it_went(tmp_path: Path, suffix: str) -> None:
    back = read_map(written(tmp_path, suffix), "another name")
    assert back.maps == MAP.maps
    assert np.abs(move_to_datum(back, DATUM).xy_m - MAP.xy_m).max() < TENTH_MM_M
    assert np.abs(back.xy_m - MAP.xy_m).max() < TENTH_MM_M  # in the robot's own map, too
    for name in MAP.rows.dtype.names or ():
        if name not in {"x_map_m", "y_map_m"}:
            assert np.array_equal(back.rows[name], MAP.rows[name], equal_nan=True), name


@pytest.mark.parametrize("suffix", FORMATS)
def test_large_ids_and_long_names_come_back_whole(tmp_path: Path, suffix: str) -> None:
    rows = MAP.rows.copy()
    rows["id"] += 1_700_000_000_000
    rows["sightings"][0] = 2_000_000_000
    far = MAP._replace(maps=("поле за рекой, второй робот, утро",), rows=rows)
    back = read_map(written(tmp_path, suffix, far), "another name")
    assert back.maps == far.maps
    for name in ("id", "sightings"):
        assert np.array_equal(back.rows[name], rows[name]), name


def test_a_name_too_long_for_a_shapefile_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"has 300 bytes, a Shapefile takes 254"):
        written(tmp_path, ".shp", MAP._replace(maps=("x" * 300,)))


@pytest.mark.parametrize("suffix", sorted(FORMATS.keys() - {".shp", ".shp.zip"}))
def test_a_merged_map_comes_back_with_all_that_it_was_merged_from(
    tmp_path: Path, suffix: str
) -> None:
    back = read_map(written(tmp_path, suffix, MERGED), "x")
    assert back.maps == MERGED.maps
    again = merge_maps([back, MERGED])
    assert np.array_equal(again.rows["group"], MERGED.rows["group"])
    assert np.abs(again.xy_m - MERGED.xy_m).max() < TENTH_MM_M


def test_a_merged_map_in_a_shapefile_is_not_merged_again(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"merged from several maps.*GeoPackage"):
        read_map(written(tmp_path, ".shp", MERGED), "x")


def test_a_map_that_is_read_and_written_again_is_the_same_file(tmp_path: Path) -> None:
    for table in (MAP, MERGED):
        first = written(tmp_path, ".geojson", table)
        data = first.read_bytes()
        write_map(first, merge_maps([read_map(first, "x")]))
        assert first.read_bytes() == data


@needs("ogr2ogr")
@pytest.mark.parametrize("suffix", FORMATS)
def test_gdal_reads_places_and_attributes_of_every_format(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path, suffix)
    source = f"/vsizip/{path}" if suffix == ".shp.zip" else str(path)
    hints = ["-oo", "X_POSSIBLE_NAMES=lon_deg", "-oo", "Y_POSSIBLE_NAMES=lat_deg"]
    out = tmp_path / "seen.csv"
    ogr(
        "ogr2ogr", "-f", "CSV", str(out), source, *(hints if suffix == ".csv" else []),
        *(["weed_map"] if suffix == ".gpkg" else []), "-lco", "GEOMETRY=AS_XY",
    )  # fmt: skip
    seen = list(csv.DictReader(out.read_text().splitlines()))
    wanted = [record for records in iterate_records(MAP) for record in records]
    assert len(seen) == len(wanted)
    for row, record in zip(seen, wanted, strict=True):
        values = dict(zip(COLUMNS, record.values, strict=True))
        assert (float(row["X"]), float(row["Y"])) == pytest.approx(
            (record.lon_deg, record.lat_deg), abs=1e-9
        )
        for name in ("class", "decision", "outcome"):
            assert row[name] == (values[name] or "")
        for name in ("confidence", "xx_m2", "xy_m2", "yy_m2"):
            assert float(row[name]) == pytest.approx(values[name], abs=1e-9)
        assert int(row["id"]) == values["id"]


@needs("ogr2ogr")
@pytest.mark.parametrize("suffix", [".geojson", ".gpkg", ".shp", ".kml"])
def test_a_map_that_went_through_another_program_is_the_same_map(
    tmp_path: Path, suffix: str
) -> None:
    out = tmp_path / f"theirs{suffix}"
    exact = ["-lco", "COORDINATE_PRECISION=9"] if suffix == ".geojson" else []
    ogr("ogr2ogr", str(out), str(written(tmp_path, ".gpkg")), "weed_map", *exact)
    back = read_map(out, "x")
    assert back.maps == MAP.maps
    assert np.abs(move_to_datum(back, DATUM).xy_m - MAP.xy_m).max() < TENTH_MM_M
    for name in ("id", "plant", "decision", "outcome", "sightings"):
        assert np.array_equal(back.rows[name], MAP.rows[name]), name
    for name in ("confidence", "xx_m2", "xy_m2", "treated_s", "first_seen_s", "last_seen_s"):
        assert np.allclose(back.rows[name], MAP.rows[name], atol=1e-4, equal_nan=True), name


@needs("ogr2ogr")
@pytest.mark.parametrize("suffix", [".geojson", ".gpkg", ".shp", ".kml"])
def test_gdal_takes_the_coordinates_for_wgs_84(tmp_path: Path, suffix: str) -> None:
    told = ogr("ogrinfo", "-ro", "-al", "-so", str(written(tmp_path, suffix)))
    assert 'GEOGCRS["WGS 84"' in told


@pytest.mark.skipif(not HAS_QGIS, reason="QGIS is missing (apt-get install python3-qgis)")
def test_qgis_draws_the_geopackage_in_its_own_style(tmp_path: Path) -> None:
    path = written(tmp_path, ".gpkg")
    program = Path(__file__).with_name("qgis_reader.py")
    done = subprocess.run(
        [str(SYSTEM_PYTHON), str(program), f"{path}|layername=weed_map"],
        capture_output=True, text=True, check=True,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen", "XDG_RUNTIME_DIR": str(tmp_path)},
    )  # fmt: skip
    (seen,) = json.loads(done.stdout.splitlines()[-1])
    assert (seen["crs"], seen["count"]) == ("EPSG:4326", len(MAP.rows))
    assert seen["renderer"] == "categorizedSymbol"
    for records in iterate_records(MAP):
        for record in records:
            values = dict(zip(COLUMNS, record.values, strict=True))
            assert seen["drawn"][str(values["id"])] == STYLES[find_style(values)]
    assert len(set(seen["drawn"].values())) >= 3


def test_every_plant_has_its_class_certainty_decision_and_outcome(tmp_path: Path) -> None:
    features = json.loads(written(tmp_path, ".geojson").read_text())["features"]
    for feature in features:
        told = feature["properties"]
        assert told["class"] in {"weed", "crop"} and 0.0 < told["confidence"] < 1.0
        assert told["xx_m2"] * told["yy_m2"] > told["xy_m2"] ** 2
        assert told["id"] and told["first_seen_s"] <= told["last_seen_s"]
        if told["class"] == "crop":
            assert (told["decision"], told["outcome"]) == ("spare", None)
        elif told["treated_s"] is not None:
            assert (told["decision"], told["outcome"]) == ("treat", "treated")
        else:
            assert (told["decision"], told["outcome"]) in {("treat", "missed"), ("spare", None)}


def spoil(path: Path, edit: Callable[[Any], Any]) -> Path:
    path.write_text(json.dumps(edit(json.loads(path.read_text()))))
    return path


def of_each(change: Callable[[dict[str, Any], list[float]], None]) -> Callable[[Any], Any]:
    def edit(root: Any) -> Any:
        for feature in root["features"]:
            change(feature["properties"], feature["geometry"]["coordinates"])
        return root

    return edit


BROKEN: dict[str, tuple[Callable[[Any], Any], str]] = {
    "another CRS": (
        lambda root: {**root, "crs": {"properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}},
        r"25832; convert it to WGS-84",
    ),
    "metres for degrees": (of_each(lambda _, at: at.__setitem__(0, 677_000.0)), r"not in degrees"),
    "no place": (of_each(lambda _, at: at.__setitem__(slice(2), [0.0, 0.0])),
                 r"plant 1: latitude 0, longitude 0 is what devices write"),
    "swapped ids": (of_each(lambda told, _: told.update(map_id=7)), r"have the id 7"),
    "mirrored axes": (
        of_each(lambda told, _: told.update(x_map_m=-told["x_map_m"])), r"mirrored.*West",
    ),
    "exchanged axes": (
        of_each(lambda t, _: t.update(x_map_m=t["y_map_m"], y_map_m=t["x_map_m"])),
        r"x_map_m and y_map_m are exchanged",
    ),
    "moved places": (of_each(lambda told, at: at.__setitem__(0, at[0] + told["id"] * 1e-5)),
                     r"m apart; drop these two columns"),
    "an unknown class": (of_each(lambda told, _: told.update({"class": 2})), r"--classes 2=weed"),
    "a negative variance": (of_each(lambda told, _: told.update(xx_m2=-1.0)), r"covariance"),
    "certain beyond one": (of_each(lambda told, _: told.update(confidence=90)), r"confidence"),
    "ids that are no whole numbers": (
        of_each(lambda told, _: told.update(map_id=told["id"] + 0.5)), r"id '1.5' is not a whole"),
    "ids of letters": (
        of_each(lambda told, _: told.update(map_id="A-12")), r"id 'A-12' is not a whole number"),
    "no number": (of_each(lambda told, _: told.update(area_m2="big")), r"plant 1.*'big'"),
    "lines for points": (lambda root: {**root, "features": [
        {"geometry": {"type": "LineString", "coordinates": []}, "properties": {}}]}, r"a Point"),
    "no collection": (lambda root: root["features"], r"cannot be read"),
}  # fmt: skip


@pytest.mark.parametrize("what", BROKEN)
def test_a_map_with_a_fault_is_refused_with_its_name(tmp_path: Path, what: str) -> None:
    edit, words = BROKEN[what]
    with pytest.raises(RecordingError, match=words):
        read_map(spoil(written(tmp_path, ".geojson"), edit), "x")


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("kept_ratio", [0.0, 0.3, 0.9])
def test_a_file_that_is_cut_off_is_refused(tmp_path: Path, suffix: str, kept_ratio: float) -> None:
    path = written(tmp_path, suffix)
    cut = path.with_suffix(".dbf") if suffix == ".shp" else path
    data = cut.read_bytes()
    cut.write_bytes(data[: int(kept_ratio * len(data))])
    with pytest.raises(RecordingError, match="north field"):
        read_map(path, "x")


def test_an_archive_that_a_mac_packed_is_read_like_any_other(tmp_path: Path) -> None:
    path = written(tmp_path, ".shp.zip")
    with zipfile.ZipFile(path, "a") as archive:
        for name in archive.namelist():
            archive.writestr(f"__MACOSX/._{name}", b"\x00\x05\x16\x07 Mac OS X")
    assert np.array_equal(read_map(path, "x").rows["id"], MAP.rows["id"])


def test_an_archive_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.shp.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bomb.shp", bytes(120_000_000))
    assert path.stat().st_size < 200_000
    with pytest.raises(RecordingError, match=r"unpacks to 120000000 bytes, more than 100000000"):
        read_map(path, "x")


def test_a_kml_that_grows_by_its_entities_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "laughs.kml"
    path.write_text('<!DOCTYPE kml [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><kml>&b;</kml>')
    with pytest.raises(RecordingError, match="document type declarations are not accepted"):
        read_map(path, "x")


KML_WITHOUT_PLANTS = {
    "an area": (
        "<kml><Placemark><Polygon><outerBoundaryIs><LinearRing><coordinates>11,52 11.1,52 11.1,52.1"
        "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>",
        "none of its 1 features",
    ),
    "a link": ("<kml><NetworkLink><Link/></NetworkLink></kml>", "none of its 1 features"),
    "two points in one": (
        "<kml><Placemark><MultiGeometry><Point><coordinates>11,52</coordinates></Point><Point>"
        "<coordinates>11,52.1</coordinates></Point></MultiGeometry></Placemark></kml>",
        "a placemark has several",
    ),
    "another format": ('<gpx><wpt lat="52" lon="11"/></gpx>', "begins with <gpx>"),
}


@pytest.mark.parametrize("what", KML_WITHOUT_PLANTS)
def test_a_kml_of_which_plants_would_be_lost_is_refused(tmp_path: Path, what: str) -> None:
    text, words = KML_WITHOUT_PLANTS[what]
    path = tmp_path / "scouted.kml"
    path.write_text(text)
    with pytest.raises(RecordingError, match=words):
        read_map(path, "x")


def test_a_kml_without_anything_in_it_is_an_empty_map(tmp_path: Path) -> None:
    empty = MAP._replace(rows=MAP.rows[:0])
    assert len(read_map(written(tmp_path, ".kml", empty), "x").rows) == 0


def test_a_view_that_never_ends_is_stopped(tmp_path: Path) -> None:
    path = written(tmp_path, ".gpkg")
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "ALTER TABLE weed_map RENAME TO hidden; CREATE VIEW weed_map AS WITH RECURSIVE n(i) AS"
            " (SELECT 1 UNION ALL SELECT i FROM n) SELECT count(*) AS c, NULL AS geom FROM n;"
        )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("agribot.gis.weeds.geopackage_file._MAX_STEPS", 3_000_000)
        with pytest.raises(RecordingError, match="interrupted"):
            read_map(path, "x")


def test_a_geopackage_in_other_coordinates_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, ".gpkg")
    with closing(sqlite3.connect(path)) as database:
        database.execute("UPDATE gpkg_geometry_columns SET srs_id = 25832")
        database.commit()
    with pytest.raises(RecordingError, match=r"EPSG:25832; convert it to EPSG:4326"):
        read_map(path, "x")


def test_a_shapefile_in_other_coordinates_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, ".shp")
    path.with_suffix(".prj").write_text('PROJCS["ETRS89 / UTM zone 32N"]')
    with pytest.raises(RecordingError, match=r"not WGS-84"):
        read_map(path, "x")


@pytest.mark.parametrize("has_place", [True, False])
def test_a_record_of_a_shapefile_without_a_place_is_left_out(
    tmp_path: Path, has_place: bool
) -> None:
    path = tmp_path / "scouted.shp"
    with shapefile.Writer(str(path), shapeType=shapefile.POINT) as writer:
        writer.field("class", "C", 10)
        writer.null()
        writer.record("weed")
        if has_place:
            writer.point(11.6, 52.1)
            writer.record("crop")
    path.with_suffix(".prj").write_text(WGS84)
    assert is_crop(read_map(path, "x").rows).tolist() == [True] * has_place


def test_classes_of_a_shapefile_are_read_in_its_encoding(tmp_path: Path) -> None:
    path = tmp_path / "scouted.shp"
    with shapefile.Writer(str(path), shapeType=shapefile.POINT, encoding="cp1252") as writer:
        writer.field("class", "C", 10)
        for number, name in enumerate(("Möhre", "Ampfer")):
            writer.point(11.6 + number * 1e-5, 52.1)
            writer.record(name)
    path.with_suffix(".prj").write_text(WGS84)
    found = read_map(path, "x", {"möhre": "crop", "ampfer": "weed"})
    assert is_crop(found.rows).tolist() == [True, False]


def test_plants_without_an_id_are_numbered() -> None:
    plants = [(11.6, 52.1, {"id": None}), (11.60001, 52.1, {"id": None, "map_id": None})]
    assert tabulate_found(Reading(plants), "'x'", "scouted").rows["id"].tolist() == [1, 2]


def test_points_of_a_scout_without_any_columns_are_weeds_of_unknown_certainty() -> None:
    found = tabulate_found(Reading([(11.6, 52.1, {}), (11.60001, 52.1, {})]), "'x'", "scouted")
    assert found.maps == ("scouted",) and found.rows["id"].tolist() == [1, 2]
    assert np.isnan(found.rows["confidence"]).all()
    assert [DECISIONS[c] + OUTCOMES[c] for c in found.rows["decision"]] == ["", ""]


# The command


def field_around(path: Path) -> Path:
    corners = np.array([[-3, -3], [43, -3], [43, 43], [-3, 43], [-3, -3.0]])
    ring = MAP.frame.lonlat_from_map(corners).tolist()
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return path


def test_the_command_exports_what_the_name_says(tmp_path: Path, capsys: Any) -> None:
    source = written(tmp_path, ".geojson")
    assert main(["weeds", "export", str(source), "-o", str(tmp_path / "a.gpkg"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["weeds"] + told["crops"] == len(MAP.rows) and told["treated"] > 0
    assert (tmp_path / "a.gpkg").read_bytes()[:15] == b"SQLite format 3"


def test_the_command_merges_under_other_names(tmp_path: Path, capsys: Any) -> None:
    one, out = written(tmp_path, ".geojson"), tmp_path / "all.geojson"
    words = ["weeds", "merge", f"may={one}", f"june={one}", "-o", str(out), "--json"]
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["maps"] == ["june", "may"]
    assert told["in_several_maps"] == len(MAP.rows)


@pytest.mark.parametrize(
    ("exchange", "words"),
    [
        ((0, 1), ""),
        ((1, 0), "longitude and latitude are exchanged"),
    ],
)
def test_the_command_refuses_plants_outside_the_field(
    tmp_path: Path, capsys: Any, exchange: tuple[int, int], words: str
) -> None:
    field = field_around(tmp_path / "field.geojson")
    places = [f"{a[exchange[0]]},{a[exchange[1]]}" for a in MAP.frame.lonlat_from_map(MAP.xy_m)]
    source = tmp_path / "scouted.csv"
    source.write_text("\n".join(["lon,lat", *places]) + "\n")
    out = ["--field", str(field), "-o", str(tmp_path / "taken.geojson")]
    status = main(["weeds", "import", str(source), *out])
    said = capsys.readouterr().err
    assert (status, words in said) == (2 if words else 0, True)
    assert (tmp_path / "taken.geojson").exists() == (status == 0)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
def test_a_table_of_a_european_spreadsheet_is_the_same_map(encoding: str, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.csv", tmp_path / "theirs.csv"
    ours.write_text("lon,lat,map,std_m\n11.6,52.1,Süd,0.02\n11.60001,52.1,Süd,0.03\n", "utf-8")
    theirs.write_text(
        "lon;lat;map;std_m\n11,6;52,1;Süd;0,02\n11,60001;52,1;Süd;0,03\n", encoding=encoding
    )
    wanted, found = read_map(ours, "m"), read_map(theirs, "m")
    assert found.maps == wanted.maps == ("Süd",)
    assert found.datum == wanted.datum
    assert (found.rows == wanted.rows).tolist() == (wanted.rows == wanted.rows).tolist()
    assert np.allclose(found.rows["xx_m2"], (0.02**2, 0.03**2), rtol=0.01)


def test_the_command_takes_classes_by_their_numbers(tmp_path: Path, capsys: Any) -> None:
    source = tmp_path / "scouted.csv"
    source.write_text("lon,lat,class\n11.6,52.1,1\n11.60001,52.1,2\n")
    out = ["-o", str(tmp_path / "taken.csv"), "--json"]
    assert main(["weeds", "import", str(source), *out]) == 2
    assert "--classes 1=weed" in capsys.readouterr().err
    assert main(["weeds", "import", str(source), "--classes", "1=crop,2=weed", *out]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (told["crops"], told["weeds"]) == (1, 1)


def write_multipoints(path: Path, count: int) -> Path:
    """Write one plant as a MultiPoint of `count` places, as QGIS saves a layer of points."""
    places = [[11.6 + 1e-5 * number, 52.1] for number in range(count)]
    shape = {"type": "MultiPoint", "coordinates": places}
    if path.suffix == ".geojson":
        empty: dict[str, Any] = {"type": "Feature", "geometry": None, "properties": {}}
        lost = {**empty, "geometry": {"type": "Point", "coordinates": []}}
        features = [empty, lost, {"type": "Feature", "geometry": shape, "properties": {}}]
        path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    elif path.suffix == ".shp":
        with shapefile.Writer(str(path), shapeType=shapefile.MULTIPOINT) as writer:
            writer.field("class", "C", 10)
            writer.multipoint(places)
            writer.record("weed")
        path.with_suffix(".prj").write_text(WGS84)
    else:
        write_map(path, MAP)
        blob = (
            b"GP\x00\x01"
            + (4326).to_bytes(4, "little")
            + shapely.to_wkb(shapely.MultiPoint(places))
        )
        with closing(sqlite3.connect(path)) as database:
            database.execute("DELETE FROM weed_map WHERE fid > 1")
            database.execute(
                "UPDATE weed_map SET geom = ?, x_map_m = NULL, y_map_m = NULL", (blob,)
            )
            database.execute("UPDATE gpkg_geometry_columns SET geometry_type_name = 'MULTIPOINT'")
            database.commit()
    return path


@pytest.mark.parametrize("suffix", [".geojson", ".shp", ".gpkg"])
def test_a_multipoint_of_one_place_is_a_plant_and_one_of_several_is_refused(
    tmp_path: Path, suffix: str
) -> None:
    one = read_map(write_multipoints(tmp_path / f"one{suffix}", 1), "x")
    assert one.frame.lonlat_from_map(one.xy_m)[0] == pytest.approx((11.6, 52.1), abs=1e-8)
    with pytest.raises(RecordingError, match=r"a [Pp]oint, "):
        read_map(write_multipoints(tmp_path / f"two{suffix}", 2), "x")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("suffix", [".geojson", ".kml"])
def test_a_weed_map_that_windows_saved_is_the_same_map(
    tmp_path: Path, suffix: str, encoding: str
) -> None:
    path = tmp_path / f"a{suffix}"
    write_map(path, MAP)
    text = path.read_text("utf-8").replace('encoding="utf-8"', 'encoding="UTF-8"')
    path.write_bytes(("\n" * (suffix == ".kml") + text).encode(encoding))
    assert np.array_equal(read_map(path, "x").rows["id"], MAP.rows["id"])
