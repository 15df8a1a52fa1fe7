"""Field files of other programs: every corner stays where it is, and nothing broken gets in."""

from __future__ import annotations

import io
import json
import math
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import gpxpy
import pytest
import shapefile
from isoxml.converter.shapely_geom import ShapelyConverterV4
from isoxml.models.base.v4 import GuidancePatternType as Pattern
from isoxml.util.isoxml_io import isoxml_from_zip

from agribot.autonomy.plan.coverage.area import FieldArea
from agribot.cli.main import main
from agribot.core.errors import MissionError
from agribot.core.fact_text import render
from agribot.core.facts import (
    EndingUnknown,
    Fact,
    FileBroken,
    FileKindUnknown,
    ListMissing,
    NotDegrees,
    NotGeojson,
    NothingDrawn,
    NotLonLat,
)
from agribot.core.geo import Datum, MapFrame
from agribot.gis.field_file import read_field
from agribot.gis.formats import geopackage, untrusted
from agribot.gis.formats.table import (
    READERS,
    WRITERS,
    read_field_file,
    read_fields,
    write_field_file,
)
from tests.finding import find, is_like

HERE = Datum(lat_deg=52.1, lon_deg=11.6)
FRAME = MapFrame(HERE)
BOUNDARY = [(0.0, 0.0), (61.234, 0.5), (60.0, 41.777), (0.0, 40.0)]
POND = [(10.0, 8.0), (14.0, 8.0), (14.0, 12.0), (10.0, 12.0)]
SHED = [(40.0, 30.0), (44.5, 30.0), (44.5, 33.0), (40.0, 33.0)]
ROW = [(3.0, 3.0), (3.004, 17.0), (3.1, 30.0)]
AB = [(0.0, 1.0), (30.0, 2.0)]
GOAL = (5.0, 6.0)
MILLIMETRE_M = 0.001


def lonlat(points: list[tuple[float, float]]) -> list[list[float]]:
    places = [FRAME.geodetic_from_map(*point) for point in points]
    return [[lon_deg, lat_deg] for lat_deg, lon_deg, _ in places]


def ring(points: list[tuple[float, float]]) -> list[list[float]]:
    line = lonlat(points)
    return [*line, line[0]]


def feature(kind: str, geometry: str, coordinates: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"kind": kind, "name": f"the {kind}"},
        "geometry": {"type": geometry, "coordinates": coordinates},
    }


FIELD = {
    "type": "FeatureCollection",
    "features": [
        feature("boundary", "Polygon", [ring(BOUNDARY), ring(POND)]),
        feature("obstacle", "Polygon", [ring(SHED)]),
        feature("row", "LineString", lonlat(ROW)),
        feature("ab_line", "LineString", lonlat(AB)),
        feature("waypoint", "Point", lonlat([GOAL])[0]),
    ],
}


def saved(folder: Path, ending: str, data: bytes) -> Path:
    path = folder / f"north field{ending}"
    path.write_bytes(data)
    return path


def apart_m(found: tuple[tuple[float, float], ...], wanted: list[tuple[float, float]]) -> float:
    """From each wanted point to the nearest found one, at worst; infinite where some are lost."""
    if len(found) != len(wanted):
        return math.inf
    return max(min(math.dist(a, b) for b in found) for a in wanted)


def check(area: FieldArea) -> None:
    assert apart_m(area.boundary, BOUNDARY) < MILLIMETRE_M
    assert len(area.holes) == 2
    for hole in (POND, SHED):
        assert min(apart_m(found, hole) for found in area.holes) < MILLIMETRE_M
    assert apart_m(area.rows[0], ROW) < MILLIMETRE_M
    assert apart_m(area.ab_line, AB) < MILLIMETRE_M
    assert apart_m(area.waypoints, [GOAL]) < MILLIMETRE_M


@pytest.mark.parametrize("ending", WRITERS)
def test_a_field_comes_back_from_every_format_within_a_millimetre(
    ending: str, tmp_path: Path
) -> None:
    area, _ = read_field(saved(tmp_path, ending, write_field_file(ending, FIELD)), HERE)
    check(area)


def test_a_terminal_reads_the_task_data_as_a_partfield(tmp_path: Path) -> None:
    """Read with the library of other people, which checks it against the schema."""
    with zipfile.ZipFile(io.BytesIO(write_field_file(".isoxml.zip", FIELD))) as archive:
        text = archive.read("TASKDATA/TASKDATA.XML")
    flat = saved(tmp_path, ".zip", untrusted.pack({"TASKDATA.XML": text}))
    tasks, _ = isoxml_from_zip(flat)
    [field] = tasks.partfields
    assert field.designator == "the boundary"
    assert field.area == pytest.approx(2476, abs=60)
    outline = ShapelyConverterV4().to_shapely_polygon(field.polygons[0])
    found = [FRAME.map_from_geodetic(lat, lon, 0.0)[:2] for lon, lat in outline.exterior.coords]
    assert apart_m(tuple(found[:-1]), BOUNDARY) < MILLIMETRE_M
    assert len(outline.interiors) == 1
    patterns = field.guidance_groups[0].guidance_patterns
    assert [pattern.type for pattern in patterns] == [Pattern.Curve, Pattern.AB]


def test_another_program_reads_the_gpx(tmp_path: Path) -> None:
    gpx = gpxpy.parse(write_field_file(".gpx", FIELD).decode())
    assert [track.type for track in gpx.tracks] == ["boundary", "obstacle", "obstacle"]
    assert [route.type for route in gpx.routes] == ["row", "ab_line"]
    lon_deg, lat_deg = lonlat([GOAL])[0]
    assert (gpx.waypoints[0].longitude, gpx.waypoints[0].latitude) == pytest.approx(
        (lon_deg, lat_deg), abs=1e-8
    )


def task_data(tmp_path: Path, **files: str) -> Path:
    members = {f"{name}.XML": text.encode() for name, text in files.items()}
    return saved(tmp_path, ".zip", untrusted.pack(members))


def test_task_data_of_farm_software_gives_its_partfield(tmp_path: Path) -> None:
    """Version 3: the field in a file of its own, no position repeated, much of no use here."""
    shed = "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lon, lat in lonlat(SHED))
    outline = "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lon, lat in lonlat(BOUNDARY))
    field = f"""<XFC><PFD A="PFD7" C="North" D="2400">
        <PLN A="1"><LSG A="1">{outline}</LSG></PLN>
        <PLN A="6"><LSG A="1">{shed}</LSG></PLN>
        <PLN A="10"><LSG A="1">{shed}</LSG></PLN>
        <LSG A="4">{shed}</LSG><PNT A="5" C="52.1" D="11.5"/></PFD></XFC>"""
    main_file = '<ISO11783_TaskData VersionMajor="3"><XFR A="PFD00007" B="1"/><CTR A="CTR1"/>'
    path = task_data(tmp_path, TASKDATA=f"{main_file}</ISO11783_TaskData>", PFD00007=field)
    area, _ = read_field(path, HERE)
    assert apart_m(area.boundary, BOUNDARY) < MILLIMETRE_M
    assert [apart_m(hole, SHED) < MILLIMETRE_M for hole in area.holes] == [True]
    assert (area.rows, area.waypoints) == ((), ())


def recorded(points: list[tuple[float, float]], kind: str = "running") -> bytes:
    track = "".join(f'<trkpt lat="{lat}" lon="{lon}"/>' for lon, lat in lonlat(points))
    return f"<gpx><trk><type>{kind}</type><trkseg>{track}</trkseg></trk></gpx>".encode()


def test_a_field_that_was_walked_around_is_a_boundary_and_a_line_is_a_row() -> None:
    """Two fixes of a receiver at one place are metres apart."""
    around = [*BOUNDARY, (1.5, 2.0)]
    [walked] = read_field_file("watch.gpx", recorded(around))["features"]
    assert (walked["geometry"]["type"], walked["properties"]["kind"]) == ("Polygon", "boundary")
    corners = walked["geometry"]["coordinates"][0]
    assert corners[0] == corners[-1]
    assert len(corners) == len(around) + 1
    [row] = read_field_file("watch.gpx", recorded(BOUNDARY))["features"]
    assert (row["geometry"]["type"], row["properties"]["kind"]) == ("LineString", "row")


BOMB = b'<!DOCTYPE k [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><kml>&b;</kml>'


def never_ending() -> bytes:
    """A layer that is a program."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute("CREATE TABLE gpkg_geometry_columns (table_name, column_name, srs_id)")
        database.execute("INSERT INTO gpkg_geometry_columns VALUES ('f', 'geom', 4326)")
        database.execute(
            "CREATE VIEW f AS WITH RECURSIVE n(x) AS (VALUES(1) UNION ALL SELECT x+1 FROM n)"
            " SELECT NULL AS geom, max(x) FROM n"
        )
        database.commit()
        return database.serialize()


def many_files() -> bytes:
    return untrusted.pack({f"{number}.shp": b"" for number in range(untrusted.MAX_MEMBERS + 1)})


def zeros(name: str) -> bytes:
    buffer = io.BytesIO()
    with (
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open(name, "w") as member,
    ):
        for _ in range(1 + untrusted.MAX_FILE_BYTES // 2**20):
            member.write(bytes(2**20))
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("encoding", "cpg"),
    [("cp1252", b""), ("utf-8", b""), ("cp1252", b"1252"), ("cp1251", b"windows-1251")],
)
def test_names_of_a_shapefile_are_read_in_its_encoding(encoding: str, cpg: bytes) -> None:
    name = "поле" if encoding == "cp1251" else "Möhrenfeld"
    shp, shx, dbf = io.BytesIO(), io.BytesIO(), io.BytesIO()
    with shapefile.Writer(shp=shp, shx=shx, dbf=dbf, encoding=encoding) as writer:
        writer.field("name", "C")
        writer.poly([ring(BOUNDARY)])
        writer.record(name)
        writer.close()
    files = {"a.shp": shp.getvalue(), "a.dbf": dbf.getvalue(), **({"a.cpg": cpg} if cpg else {})}
    field = read_field_file("a.zip", untrusted.pack(files))
    assert field["features"][0]["properties"]["name"] == name


def shapes_in(projection: bytes) -> bytes:
    shp, shx, dbf = io.BytesIO(), io.BytesIO(), io.BytesIO()
    with shapefile.Writer(shp=shp, shx=shx, dbf=dbf) as writer:
        writer.field("name", "C")
        writer.point(11.6, 52.1)
        writer.record("here")
        writer.close()
    files = {"a.shp": shp, "a.shx": shx, "a.dbf": dbf, "a.prj": io.BytesIO(projection)}
    return untrusted.pack({name: part.getvalue() for name, part in files.items()})


HOSTILE: dict[str, tuple[str, Callable[[], bytes], str | Fact]] = {
    "entities": ("a.kml", lambda: BOMB, "document type"),
    "entities in UTF-16": ("a.gpx", lambda: BOMB.decode().encode("utf-16"), "document type"),
    "entities in task data": (
        "a.zip", lambda: untrusted.pack({"TASKDATA.XML": BOMB}), "document type"),
    "deep": ("a.gpx", lambda: b"<a>" * 5000 + b"</a>" * 5000, "inside each other"),
    "archive bomb": ("a.kmz", lambda: zeros("doc.kml"), "unpacks to"),
    "task data bomb": (
        "a.zip", lambda: zeros("TASKDATA.XML"), "unpacks to"),
    "many files": ("a.zip", many_files, "files inside"),
    "endless view": ("a.gpkg", never_ending, "interrupted"),
    "projected": ("a.zip", lambda: shapes_in(b'PROJCS["UTM 32N"]'), "not WGS-84"),
    "projected, in WKT 2": (
        "a.zip", lambda: shapes_in(b'PROJCRS["UTM 32N",BASEGEOGCRS["WGS 84"]]'), "not WGS-84"),
    "another datum": (
        "a.zip", lambda: shapes_in(b'GEOGCS["NAD27",DATUM["North_American_Datum_1927"]]'),
        "not WGS-84"),
    "broken": ("a.gpx", lambda: b"<gpx><trk>", "not XML"),
    "empty": ("a.gpx", lambda: b"", "not XML"),
    "no places": ("a.gpx", lambda: b"<gpx/>", NothingDrawn("'a.gpx'")),
    "no numbers": ("a.gpx", lambda: b'<gpx><wpt lat="x" lon="1"/></gpx>', "could not convert"),
    "not finite": ("a.gpx", lambda: b'<gpx><wpt lat="nan" lon="1"/></gpx>', NotDegrees(ANY, "nan")),
    "not on Earth": (
        "a.gpx", lambda: b'<gpx><wpt lat="52" lon="999"/></gpx>', NotLonLat(ANY, "[999.0, 52.0]")),
    "no longitude": ("a.gpx", lambda: b'<gpx><wpt lat="52"/></gpx>', "lon"),
    "no fields": (
        "a.zip", lambda: untrusted.pack({"TASKDATA.XML": b"<T/>"}), NothingDrawn("'a.zip'")),
    "no shapes": ("a.zip", lambda: untrusted.pack({"a.txt": b""}), "no .shp"),
    "cut off": ("a.zip", lambda: write_field_file(".shp.zip", FIELD)[:-40], "zip"),
    "a ring without corners": (
        "a.geojson", lambda: b'{"type": "Polygon", "coordinates": [[]]}', "a ring has no places"),
    "empty alone": (
        "a.geojson", lambda: b'{"type": "Polygon", "coordinates": []}',
        NothingDrawn("'a.geojson'")),
    "a list": ("a.geojson", lambda: b"[0, 0]", NotGeojson("the file", "list")),
    "a number for a feature": (
        "a.geojson", lambda: b'{"type": "FeatureCollection", "features": [5]}',
        NotGeojson("feature 0", "int")),
    "a number for features": (
        "a.geojson", lambda: b'{"type": "FeatureCollection", "features": 5}',
        ListMissing("the file", "FeatureCollection", "features")),
    "a number for a geometry": (
        "a.geojson", lambda: b'{"type": "GeometryCollection", "geometries": [0]}',
        "expected a GeoJSON object, got int"),
    "unknown": ("a.dwg", lambda: b"", FileKindUnknown("'a.dwg'", ANY)),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_broken_or_hostile_file_is_refused_in_one_sentence(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(geopackage, "_MAX_STEPS", 2_000_000)
    file_name, data, why = HOSTILE[name]
    with pytest.raises(MissionError) as raised:
        read_field_file(file_name, data())
    if isinstance(why, Fact):
        assert is_like(raised.value.fact, why)
    else:
        assert why in find(raised.value.fact, FileBroken).error
    assert "\n" not in str(raised.value)


def test_features_without_a_place_are_left_out() -> None:
    nothing = [
        {"type": "Feature", "properties": {}, "geometry": geometry}
        for geometry in (None, {"type": "Polygon", "coordinates": []})
    ]
    tree = {**FIELD, "features": [*nothing, *FIELD["features"]]}
    found = read_field_file("a.geojson", json.dumps(tree).encode())
    assert len(found["features"]) == len(FIELD["features"])


def test_names_in_an_archive_lead_nowhere(tmp_path: Path) -> None:
    inside = write_field_file(".kml", FIELD)
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    path = saved(folder, ".kmz", untrusted.pack({"../../escaped.kml": inside}))
    area, _ = read_field(path, HERE)
    check(area)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["a", "b", path.name]


@pytest.mark.parametrize("ending", [".shp.zip", ".kmz", ".isoxml.zip"])
def test_an_archive_that_a_mac_packed_is_read_like_any_other(ending: str, tmp_path: Path) -> None:
    marks = b"\x00\x05\x16\x07\x00\x02\x00\x00Mac OS X        "
    with zipfile.ZipFile(io.BytesIO(write_field_file(ending, FIELD))) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    shadows = {f"__MACOSX/{Path(name).with_name('._' + Path(name).name)}": marks for name in files}
    area, _ = read_field(saved(tmp_path, ending, untrusted.pack(shadows | files)), HERE)
    check(area)


def test_agribot_plan_converts_a_field_and_plans_in_any_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "field.geojson"
    source.write_text(json.dumps(FIELD), encoding="utf-8")
    for ending in (".isoxml.zip", ".gpx"):
        target = tmp_path / f"field{ending}"
        assert main(["plan", "convert", str(source), "--out", str(target), "--json"]) == 0
        assert json.loads(capsys.readouterr().out.splitlines()[-1])["features"] == 5
        area, _ = read_field(target, HERE)
        check(area)
        source = target
    assert main(["plan", "convert", str(source), "--out", str(tmp_path / "field.dwg")]) == 2
    assert main(["plan", "convert", str(tmp_path / "none.gpx"), "--out", "x.kml"]) == 2
    assert main(["plan", "convert", str(source)]) == 2
    no_rows = {**FIELD, "features": FIELD["features"][:2]}
    source.write_bytes(write_field_file(".gpx", no_rows))
    wanted = ["plan", "--field", str(source), "--implement-width", "3", "--json"]
    assert main(wanted) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["ok"] is True


def test_a_plan_is_written_in_the_format_that_its_name_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, plan = tmp_path / "field.geojson", tmp_path / "plan.kml"
    source.write_text(json.dumps({**FIELD, "features": FIELD["features"][:2]}), encoding="utf-8")
    wanted = ["plan", "--field", str(source), "--implement-width", "3", "--out"]
    assert main([*wanted, str(plan)]) == 0
    assert "agribot run --plan needs it as GeoJSON" in capsys.readouterr().err
    kinds = [one["properties"]["kind"] for one in read_fields(plan)["features"]]
    assert kinds[0] == "boundary"
    assert kinds.count("leg:swath") > 5
    assert main([*wanted, str(tmp_path / "plan.pdf")]) == 2
    refusal = capsys.readouterr().err
    named = f"--out {tmp_path / 'plan.pdf'}"
    assert render(EndingUnknown(named, ", ".join(WRITERS))) in refusal
    assert "CERTIFIED" not in refusal, "refused before anything is planned"


def test_every_format_that_is_written_is_read() -> None:
    assert {Path(ending).suffix or ending for ending in WRITERS} <= READERS.keys()


@pytest.mark.parametrize(
    "text",
    [
        '\n  <?xml version="1.0" encoding="UTF-8"?><kml><a>ü</a></kml>',
        "<kml><gx:a xmlns='x'>ü</gx:a></kml>",
        '<?xml version="1.0" encoding="utf-16"?><kml><a>ü</a></kml>',
    ],
    ids=["line before its begin", "prefix without a namespace", "declared as what it is not"],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_xml_of_the_wild_is_read(text: str, encoding: str) -> None:
    assert untrusted.read_text(untrusted.parse_xml(text.encode(encoding)), "a") == "ü"


def test_xml_in_the_encoding_that_it_declares_is_read() -> None:
    text = '<?xml version="1.0" encoding="iso-8859-2"?><kml><a>Řepa</a></kml>'
    assert untrusted.read_text(untrusted.parse_xml(text.encode("iso-8859-2")), "a") == "Řepa"
