"""Field files and prescriptions as other programs write them: read, chosen from, or named."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import numpy as np
import pytest
import shapely

from agribot.app.field_work import plan_field_file
from agribot.autonomy.plan.coverage.area import FieldArea
from agribot.autonomy.plan.ways.waypoint_text import parse_waypoints
from agribot.cli.main import main
from agribot.core.config import load
from agribot.core.errors import MissionError
from agribot.core.fact_text import render
from agribot.core.facts import (
    BoundaryCount,
    NoSuchField,
    RingCrosses,
    RingShort,
    SeveralFields,
    TaskDataOfOne,
    ZoneCrosses,
)
from agribot.core.geo import Datum, MapFrame
from agribot.description.drawn_rows import read_drawn_rows
from agribot.description.field_generator import _read_boundary
from agribot.description.field_settings import FieldSettings
from agribot.description.loader import load_robot
from agribot.gis.field_file import read_field
from agribot.gis.formats.table import WRITERS, read_field_file, write_field_file
from agribot.gis.prescription import read_prescription
from tests.finding import find, refused

HERE = Datum(lat_deg=48.2, lon_deg=11.6)
FRAME = MapFrame(HERE)
Points = Sequence[tuple[float, float]]
FIELD = [(0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)]
SOUTH = [(x + 100.0, y) for x, y in FIELD]
POND = [(20.0, 15.0), (30.0, 15.0), (30.0, 25.0), (20.0, 25.0)]
ROWS = [[(5.0, 2.0), (5.0, 38.0)], [(7.0, 2.0), (7.0, 38.0)]]
FIELD_M2 = 2400.0


def lonlat(points: Points) -> list[list[float]]:
    places: list[list[float]] = FRAME.lonlat_from_map(np.array(points, float)).tolist()
    return places


def ring(points: Points) -> list[list[float]]:
    return [*lonlat(points), lonlat(points)[0]]


def member(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def shape(kind: str, coordinates: Any, height: bool = False) -> dict[str, Any]:
    def lift(inner: Any) -> Any:
        return [*inner, 500.0] if isinstance(inner[0], float) else [*map(lift, inner)]

    return {"type": kind, "coordinates": lift(coordinates) if height else coordinates}


def read(path: Path, *members: dict[str, Any], **more: Any) -> FieldArea:
    tree = {"type": "FeatureCollection", "features": members, **more}
    path.write_text(json.dumps(tree), "utf-8")
    return read_field(path, HERE)[0]


def measure_m2(area: FieldArea) -> float:
    return float(shapely.Polygon(area.boundary, area.holes).area)


def test_a_field_as_qgis_writes_it_is_read(tmp_path: Path) -> None:
    """MultiPolygons with heights, a crs, empty columns and a record without a place."""
    parcel = shape("MultiPolygon", [[ring(FIELD), ring(POND)]], height=True)
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    found = read(
        tmp_path / "f.geojson",
        member(parcel, kind=None, Name="North"),
        member(shape("MultiLineString", [lonlat(row) for row in ROWS]), kind="row"),
        member(None, name="note"),
        crs=crs,
        name="layer",
    )
    assert measure_m2(found) == pytest.approx(FIELD_M2 - 100.0, rel=1e-4)
    assert np.array(found.rows) == pytest.approx(np.array(ROWS), abs=1e-3)
    assert found.left_out == "f.geojson: left out: a feature without a place"


def test_a_collection_of_geometries_is_all_of_them(tmp_path: Path) -> None:
    parts = [shape("Polygon", [ring(FIELD)]), shape("LineString", lonlat(ROWS[0]))]
    found = read(tmp_path / "f.json", member({"type": "GeometryCollection", "geometries": parts}))
    assert measure_m2(found) == pytest.approx(FIELD_M2, rel=1e-4)
    assert len(found.rows) == 1


def test_rows_boundaries_and_waypoints_of_qgis_are_read_where_no_field_is(tmp_path: Path) -> None:
    rows = member(shape("MultiLineString", [lonlat(row) for row in ROWS], height=True), kind=None)
    parcel = member(shape("MultiPolygon", [[ring(FIELD)]], height=True), kind="boundary")
    tree = {"type": "FeatureCollection", "features": [member(None), rows, parcel]}
    path = tmp_path / "f.geojson"
    path.write_text(json.dumps(tree))
    assert np.array(read_drawn_rows(path, HERE)) == pytest.approx(np.array(ROWS), abs=1e-3)
    plan = FieldSettings(boundary=path.name, datum=HERE)
    corners = _read_boundary(plan, tmp_path)
    assert corners is not None
    assert corners[:4] == pytest.approx(np.array(FIELD), abs=1e-3)
    way = member(shape("MultiLineString", [lonlat(ROWS[0])], height=True))
    text = json.dumps({"type": "FeatureCollection", "features": [member(None), way]})
    assert len(parse_waypoints(text, "w.geojson")) == 2


def farm() -> list[dict[str, Any]]:
    return [
        member(shape("Polygon", [ring(FIELD)]), name="North"),
        member(shape("Polygon", [ring(SOUTH)]), name="South"),
        member(shape("Polygon", [ring(POND)]), name="pond"),
        member(shape("LineString", lonlat(ROWS[0])), kind="ab_line", name="along"),
        member(
            shape("LineString", lonlat([(2.0, 3.0), (50.0, 3.0)])), kind="ab_line", name="across"
        ),
        member(shape("LineString", lonlat([(105.0, 2.0), (105.0, 38.0)])), kind="row"),
    ]


def test_one_of_several_fields_is_chosen_by_name_with_what_lies_in_it(tmp_path: Path) -> None:
    path = tmp_path / "farm.geojson"
    fields = "'North', 'South'"
    with refused(SeveralFields("farm.geojson", 2, "fields", fields, "farm.geojson#North")):
        read(path, *farm())
    south, _ = read_field(Path(f"{path}#South"), HERE)
    assert (len(south.holes), len(south.rows), south.ab_line) == (0, 1, ())
    assert np.mean(south.boundary, axis=0) == pytest.approx((130.0, 20.0), abs=1e-2)
    with refused(SeveralFields("farm.geojson", 2, "lines", "'along', 'across'", ANY)):
        read_field(Path(f"{path}#North"), HERE)
    north, _ = read_field(Path(f"{path}#North#across"), HERE)
    assert north.ab_line[1] == pytest.approx((50.0, 3.0), abs=1e-3)
    assert (len(north.holes), north.rows) == (1, ())
    with refused(NoSuchField("farm.geojson", "West", fields, ANY)):
        read_field(Path(f"{path}#West"), HERE)


def test_an_obstacle_across_the_edge_is_no_field_of_its_own(tmp_path: Path) -> None:
    across = [(50.0, 15.0), (75.0, 15.0), (75.0, 25.0), (50.0, 25.0)]
    members = [member(shape("Polygon", [ring(points)])) for points in (FIELD, across)]
    with refused(SeveralFields(ANY, 2, "fields", ANY, ANY)):
        read(tmp_path / "f.geojson", *members)
    area, _ = read_field(Path(f"{tmp_path / 'f.geojson'}#field 1"), HERE)
    assert measure_m2(area) == pytest.approx(FIELD_M2 - 100.0, rel=1e-3)


def test_a_polygon_without_an_area_is_refused_and_no_field_of_its_own(tmp_path: Path) -> None:
    flat = member(shape("Polygon", [lonlat([(5.0, 5.0), (9.0, 5.0), (5.0, 5.0)])]))
    with refused(RingShort("f.geojson: obstacle 1", 2)):
        read(tmp_path / "f.geojson", flat, member(shape("Polygon", [ring(FIELD)])))


@pytest.mark.parametrize("ending", WRITERS)
def test_fields_and_lines_of_every_format_keep_their_names(ending: str, tmp_path: Path) -> None:
    kinds = ["boundary", "boundary", "obstacle"]
    members = farm()
    for one, kind in zip(members, kinds, strict=False):
        one["properties"]["kind"] = kind
    path = tmp_path / f"farm{ending}"
    if ending == ".isoxml.zip":
        with refused(TaskDataOfOne(2, "'North', 'South'")):
            write_field_file(ending, {"type": "FeatureCollection", "features": members})
        del members[1], members[-1]
    tree = {"type": "FeatureCollection", "features": members}
    path.write_bytes(write_field_file(ending, tree))
    area, _ = read_field(Path(f"{path}#North#along"), HERE)
    assert np.mean(area.boundary, axis=0) == pytest.approx((30.0, 20.0), abs=1e-2)
    assert area.ab_line[0] == pytest.approx((5.0, 2.0), abs=1e-2)


def test_commands_take_the_name_behind_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "farm.geojson", tmp_path / "south.geojson"
    tree = {"type": "FeatureCollection", "features": farm()}
    path.write_text(json.dumps(tree))
    assert main(["plan", "--field", str(path)]) == 2
    fields = "'North', 'South'"
    several = SeveralFields("farm.geojson", 2, "fields", fields, "farm.geojson#North")
    assert render(several) in capsys.readouterr().err
    assert main(["plan", "convert", f"{path}#South", "--out", str(out)]) == 0
    kinds = [one["properties"]["kind"] for one in json.loads(out.read_text())["features"]]
    assert kinds == ["boundary", "row"]
    settings = load(
        "rows-10x12", [f"field.datum={{lat_deg={HERE.lat_deg}, lon_deg={HERE.lon_deg}}}"]
    )
    made, certificate = plan_field_file(Path(f"{path}#South"), settings, load_robot("agribot"), 0.8)
    assert certificate.ok
    assert len(made.area.rows) == 1


def partfield(name: str, points: Points, *lines: str) -> str:
    corners = "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lon, lat in ring(points))
    outline = f'<PLN A="1"><LSG A="1">{corners}</LSG></PLN>'
    return f'<PFD A="PFD1" C="{name}">{outline}{"".join(lines)}</PFD>'


def pattern(name: str, points: Points) -> str:
    places = "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lon, lat in lonlat(points))
    return f'<GGP B="lines"><GPN B="{name}" C="1"><LSG A="5">{places}</LSG></GPN></GGP>'


def pack(path: Path, **files: str | bytes) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name.replace("__", "\\").replace("_", "."), text)
    return path


def test_partfields_keep_the_lines_that_are_theirs_wherever_these_lie(tmp_path: Path) -> None:
    """A farm's A-B line often runs along a road beside the field."""
    beside = [(-20.0, 0.0), (-20.0, 40.0)]
    fields = partfield("North", FIELD, pattern("road", beside)) + partfield("South", SOUTH)
    main_file = f'<ISO11783_TaskData VersionMajor="4">{fields}</ISO11783_TaskData>'
    path = pack(tmp_path / "farm.zip", TASKDATA__TASKDATA_XML=main_file)
    north, _ = read_field(Path(f"{path}#North"), HERE)
    assert north.ab_line[0] == pytest.approx((-20.0, 0.0), abs=1e-3)
    assert read_field(Path(f"{path}#South"), HERE)[0].ab_line == ()


def kml(*shapes: str, head: str = "") -> str:
    marks = "".join(f"<Placemark><name>f</name>{one}</Placemark>" for one in shapes)
    return f'{head}<kml xmlns="http://www.opengis.net/kml/2.2"><Folder>{marks}</Folder></kml>'


def places(points: Points, comma: str = ",") -> str:
    return "\n".join(f"{lon}{comma}{lat}{comma}0" for lon, lat in ring(points))


def area_kml(comma: str = ",") -> str:
    text = f"<LinearRing><coordinates>{places(FIELD, comma)}</coordinates></LinearRing>"
    return f"<Polygon><outerBoundaryIs>{text}</outerBoundaryIs></Polygon>"


TRACK = "".join(f"<gx:coord>{lon} {lat} 0</gx:coord>" for lon, lat in ring(FIELD))
COORDS = TRACK.partition("</gx:coord>")
PAUSED = f"<gx:Track>{COORDS[0]}{COORDS[1]}</gx:Track><gx:Track>{COORDS[2]}</gx:Track>"
KML = {
    "spaces beside commas": kml(area_kml(" , ")),
    "commas behind places": kml(area_kml().replace("\n", ",\n")),
    "an empty point": kml("<Point><coordinates></coordinates></Point>", area_kml()),
    "a path around the field": kml(
        f"<LineString><coordinates>{places(FIELD)}</coordinates></LineString>"
    ),
    "a track around the field": kml(f"<gx:Track>{TRACK}</gx:Track>"),
    "a track that was paused": kml(f"<gx:MultiTrack>{PAUSED}</gx:MultiTrack>"),
    "an & and entities of HTML": kml(
        "<name>Hill &amp; Dale & Co&nbsp;&uuml;</name>",
        "<description><![CDATA[a && b]]></description>",
        area_kml(),
    ),
    "a prefix without a namespace": kml(f"<gx:drawOrder>1</gx:drawOrder>{area_kml()}"),
    "a line before its declaration": kml(area_kml(), head='\n<?xml version="1.0"?>'),
}


@pytest.mark.parametrize("what", KML)
@pytest.mark.parametrize("ending", [".kml", ".kmz"])
def test_kml_of_the_wild_is_a_field(what: str, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"f{ending}"
    if ending == ".kmz":
        pack(path, a_kml=kml("<Point><coordinates>0,1</coordinates></Point>"), doc_kml=KML[what])
    else:
        path.write_text(KML[what], "utf-8")
    area, _ = read_field(path, HERE)
    assert measure_m2(area) == pytest.approx(FIELD_M2, rel=1e-3)


def walk(points: Points, step_m: float = 2.0) -> list[tuple[float, float]]:
    """Walk from corner to corner in steps."""
    line = shapely.LineString(points)
    return [
        (point.x, point.y)
        for point in (line.interpolate(at) for at in np.arange(0.0, line.length, step_m))
    ]


def gpx(*segments: Points) -> bytes:
    parts = "".join(
        "<trkseg>"
        + "".join(f'<trkpt lat="{lat}" lon="{lon}"/>' for lon, lat in lonlat(points))
        + "</trkseg>"
        for points in segments
    )
    return f"<gpx><trk><name>walk</name>{parts}</trk></gpx>".encode()


def read_gpx(path: Path, *segments: Points) -> FieldArea:
    path.write_bytes(gpx(*segments))
    return read_field(path, HERE)[0]


AROUND = walk([*FIELD, FIELD[0]])


def test_a_walk_around_the_field_that_was_paused_is_its_outline(tmp_path: Path) -> None:
    area = read_gpx(tmp_path / "w.gpx", AROUND[:30], AROUND[32:])
    assert measure_m2(area) == pytest.approx(FIELD_M2, rel=0.01)


def test_a_walk_that_ends_8_m_short_is_closed_and_says_so(tmp_path: Path) -> None:
    area = read_gpx(tmp_path / "w.gpx", AROUND[:-3])
    assert measure_m2(area) == pytest.approx(FIELD_M2, rel=0.01)
    assert area.left_out == "w.gpx: line 'walk' is taken for an area: closed over 8.0 m"


def test_a_walk_that_goes_on_behind_its_end_ends_where_it_began(tmp_path: Path) -> None:
    beside = [(x, y + 1.0) for x, y in AROUND[:20]]
    area = read_gpx(tmp_path / "w.gpx", [*AROUND, *beside])
    assert measure_m2(area) == pytest.approx(FIELD_M2, rel=0.03)
    assert "behind its end left out" in area.left_out


def test_a_walk_that_jitters_at_rest_loses_the_loops(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rest = [(60.0 + du, 20.0 + dv) for du, dv in rng.normal(0.0, 0.3, (20, 2))]
    at = next(k for k, (x, y) in enumerate(AROUND) if x >= 60.0 and y >= 20.0)
    area = read_gpx(tmp_path / "w.gpx", [*AROUND[:at], *rest, *AROUND[at:]])
    assert measure_m2(area) == pytest.approx(FIELD_M2, rel=0.01)
    assert "loops where it crosses itself cut off" in area.left_out


@pytest.mark.parametrize("back", [False, True])
def test_lines_that_go_around_nothing_stay_rows(back: bool) -> None:
    """Two neighbouring rows end beside their begin, and are no field of 75 cm."""
    rows = [walk([(0.0, 0.0), (0.0, 90.0)]), walk([(0.75, 90.0), (0.75, 0.0)])]
    segments = [[*rows[0], *rows[1]]] if back else rows
    found = read_field_file("w.gpx", gpx(*segments))["features"]
    assert {one["properties"]["kind"] for one in found} == {"row"}
    assert len(found) == len(segments)


def test_a_figure_of_eight_is_refused_and_not_halved(tmp_path: Path) -> None:
    eight = walk([FIELD[0], FIELD[2], FIELD[1], FIELD[3], FIELD[0]])
    with refused(RingCrosses(ANY, ANY)):
        read_gpx(tmp_path / "w.gpx", eight)


def test_a_line_that_does_not_close_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with refused(BoundaryCount(ANY, 0, "")):
        read_gpx(tmp_path / "w.gpx", AROUND[:60])


def test_a_hole_that_touches_the_edge_is_cut_from_the_field(tmp_path: Path) -> None:
    corner = [(40.0, 30.0), (60.0, 30.0), (60.0, 40.0), (40.0, 40.0)]
    polygon = shape("Polygon", [ring(FIELD), ring(corner), ring(POND)])
    area = read(tmp_path / "f.geojson", member(polygon))
    assert measure_m2(area) == pytest.approx(FIELD_M2 - 200.0 - 100.0, rel=1e-3)
    assert len(area.holes) == 1
    across = [(20.0, 0.0), (30.0, 0.0), (30.0, 40.0), (20.0, 40.0)]
    divided = read(tmp_path / "f.geojson", member(shape("Polygon", [ring(FIELD), ring(across)])))
    assert measure_m2(divided) == pytest.approx(30.0 * 40.0, rel=1e-3)
    assert "a part of 800.0 m2" in divided.left_out


def test_a_zone_whose_hole_touches_its_edge_has_its_rate_beside_it() -> None:
    corner = [(40.0, 20.0), (60.0, 20.0), (60.0, 40.0), (40.0, 40.0)]
    zone = member(shape("Polygon", [ring(FIELD), ring(corner)]), Rate=200)
    zones = read_prescription("rx.geojson", json.dumps(zone).encode(), HERE)
    rates = zones.find_rates(np.array([30.0, 50.0]), np.array([30.0, 30.0]))
    assert rates[0] == 200.0 and np.isnan(rates[1])
    crossing = [FIELD[0], FIELD[2], FIELD[1], FIELD[3]]
    zone = member(shape("Polygon", [ring(crossing)]), rate=200)
    with pytest.raises(MissionError) as raised:
        read_prescription("rx.geojson", json.dumps(zone).encode(), HERE)
    at = find(raised.value.fact, ZoneCrosses).at
    assert re.fullmatch(r"latitude 48\.2\d+, longitude 11\.6\d+", at)


def task(more: str) -> str:
    return f'<XFC><TSK A="TSK1" B="spray" G="1">{more}</TSK></XFC>'


def packed_tasks(text: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr(
            "TASKDATA\\TASKDATA.XML", '<ISO11783_TaskData><XFR A="TSK00001"/></ISO11783_TaskData>'
        )
        archive.writestr("TASKDATA\\TSK00001.XML", text)
        archive.writestr("TASKDATA\\GRD00001.BIN", bytes([1, 2, 1, 2]))
    return packed.getvalue()


def test_a_file_of_its_own_that_is_not_in_the_archive_is_named(tmp_path: Path) -> None:
    path, main = tmp_path / "f.zip", '<ISO11783_TaskData><XFR A="{}"/></ISO11783_TaskData>'
    for name, read in (
        ("PFD00001", lambda: read_field(path, HERE)),
        ("TSK00001", lambda: read_prescription("f.zip", path.read_bytes(), HERE)),
    ):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("TASKDATA.XML", main.format(name))
        with pytest.raises(MissionError, match=f"{name}.XML is not inside"):
            read()


def test_a_task_in_a_file_of_its_own_is_the_prescription() -> None:
    zones = "".join(
        f'<TZN A="{code}"><PDV A="0001" B="{rate}"/></TZN>'
        for code, rate in ((1, 20000), (2, 10000))
    )
    grid = '<GRD A="48.2" B="11.6" C="1e-4" D="1e-4" E="2" F="2" G="GRD00001" H="4" I="1"/>'
    rates = read_prescription("rx.zip", packed_tasks(task(zones + grid)), HERE)
    assert rates.find_rates(np.array([3.0, 10.0]), np.array([5.0, 5.0])).tolist() == [200.0, 100.0]


def test_a_zone_of_several_outlines_covers_all_of_them() -> None:
    lines = "".join(
        '<LSG A="1">'
        + "".join(f'<PNT A="2" C="{lat}" D="{lon}"/>' for lon, lat in ring(points))
        + "</LSG>"
        for points in (FIELD, SOUTH)
    )
    zone = f'<TZN A="1"><PDV A="0001" B="20000"/><PLN A="2">{lines}</PLN></TZN>'
    rates = read_prescription("rx.zip", packed_tasks(task(zone)), HERE)
    found = rates.find_rates(np.array([30.0, 80.0, 130.0]), np.array([20.0] * 3))
    assert found[[0, 2]].tolist() == [200.0, 200.0] and np.isnan(found[1])
