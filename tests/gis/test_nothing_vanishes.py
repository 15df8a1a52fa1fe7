"""What a field file holds inside its boundary is an obstacle, or is named, and never vanishes."""

from __future__ import annotations

import io
import json
import sqlite3
import zipfile
from pathlib import Path
from typing import Any

import pytest
import shapely

from agribot.cli.main import main
from agribot.core.geo import Datum, MapFrame
from agribot.gis.field_file import read_field
from agribot.gis.formats.geopackage import write_geopackage
from agribot.gis.formats.table import read_field_file, write_field_file
from agribot.gis.geojson import parse_features

FRAME = MapFrame(Datum(lat_deg=51.0, lon_deg=7.0))
FIELD = [(0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)]
POND = [(20.0, 15.0), (30.0, 15.0), (30.0, 25.0), (20.0, 25.0)]


def place(point: tuple[float, float]) -> tuple[float, float]:
    lat_deg, lon_deg, _ = FRAME.geodetic_from_map(*point)
    return lon_deg, lat_deg


def point(at: tuple[float, float], kind: str = "2") -> str:
    lon_deg, lat_deg = place(at)
    return f'<PNT A="{kind}" C="{lat_deg:.9f}" D="{lon_deg:.9f}"/>'


def line(points: list[tuple[float, float]], kind: str) -> str:
    head = f'<LSG A="{kind}">' if kind else "<LSG>"
    return f"{head}{''.join(point(at) for at in points)}</LSG>"


def area(kind: str, ring: str, points: list[tuple[float, float]] = POND) -> str:
    head = f'<PLN A="{kind}">' if kind else "<PLN>"
    return f"{head}{line([*points, points[0]], ring)}</PLN>"


def pattern(kind: str, more: str = "") -> str:
    points = [(20.0, 5.0), (20.0, 35.0)]
    head = f'<GGP A="GGP1"><GPN A="GPN1" B="Line" {kind}{more}>'
    return f"{head}{line(points, '5')}</GPN></GGP>"


def isoxml(*elements: str) -> bytes:
    field = f'<PFD A="PFD1" C="North" D="2400">{area("1", "1", FIELD)}{"".join(elements)}</PFD>'
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr(
            "TASKDATA.XML",
            f'<ISO11783_TaskData VersionMajor="4">{field}</ISO11783_TaskData>',
        )
    return packed.getvalue()


def read(path: Path, *elements: str) -> Any:
    path.write_bytes(isoxml(*elements))
    return read_field(path, FRAME.datum)[0]


@pytest.mark.parametrize("kind", ["", "3", "4", "5", "6", "8", "11", "12", "99"])
@pytest.mark.parametrize("ring", ["", "1", "2", "9"])
def test_every_ring_of_whatever_stands_in_a_field_is_an_obstacle(
    kind: str, ring: str, tmp_path: Path
) -> None:
    found = read(tmp_path / "f.zip", area(kind, ring))
    assert len(found.holes) == 1
    assert shapely.Polygon(found.holes[0]).area == pytest.approx(100.0, rel=1e-3)
    assert not found.left_out


@pytest.mark.parametrize("ring", ["2", "9"])
def test_a_hole_in_a_boundary_of_its_own_is_an_obstacle(ring: str, tmp_path: Path) -> None:
    if ring == "9":
        hole = f'<PLN A="1">{line([*POND, POND[0]], "2")}{line([(40, 10), (44, 10), (44, 14)], "")}'
        found = read(tmp_path / "f.zip", hole + "</PLN>")
        assert len(found.holes) == 2
    else:
        assert len(read(tmp_path / "f.zip", area("1", ring)).holes) == 1


@pytest.mark.parametrize(
    ("element", "area_m2"),
    [
        (point((30.0, 20.0), "5"), 0.77),
        (point((30.0, 20.0), "99"), 0.77),
        (line([(20.0, 20.0), (30.0, 20.0)], "9"), 10.77),
        (line([(20.0, 20.0), (30.0, 20.0)], "7"), 10.77),
        (line([(20.0, 20.0), (30.0, 20.0)], ""), 10.77),
        (line([(20.0, 20.0), (30.0, 20.0)], "6").replace("<LSG", '<LSG C="4000"'), 52.2),
    ],
)
def test_points_and_lines_that_stand_in_a_field_are_obstacles_of_half_a_metre_or_their_width(
    element: str, area_m2: float, tmp_path: Path
) -> None:
    (hole,) = read(tmp_path / "f.zip", element).holes
    assert shapely.Polygon(hole).area == pytest.approx(area_m2, rel=0.02)


def test_a_fence_along_the_edge_and_a_windbreak_across_it_are_cut_to_the_field(
    tmp_path: Path,
) -> None:
    fence = line([FIELD[0], FIELD[1]], "7")
    windbreak = area("12", "1", [(50.0, 10.0), (70.0, 10.0), (70.0, 20.0), (50.0, 20.0)])
    found = read(tmp_path / "f.zip", fence, windbreak, point((90.0, 20.0), "5"))
    areas_m2 = sorted(shapely.Polygon(hole).area for hole in found.holes)
    assert areas_m2 == pytest.approx([60.0 * 0.5, 10.0 * 10.0], rel=0.06)
    assert found.left_out == "f.zip: left out: obstacle beyond the boundary"


def test_crop_that_is_kept_off_is_an_obstacle_in_task_data_and_never_a_row_to_work(
    tmp_path: Path,
) -> None:
    lines = (("boundary", "Polygon", [*FIELD, FIELD[0]]), ("crop", "LineString", POND[:2]))
    members = [
        {
            "type": "Feature",
            "properties": {"kind": kind},
            "geometry": {
                "type": shape,
                "coordinates": [[*map(place, points)]]
                if shape == "Polygon"
                else [*map(place, points)],
            },
        }
        for kind, shape, points in lines
    ]
    file = tmp_path / "f.zip"
    collection = {"type": "FeatureCollection", "features": members}
    file.write_bytes(write_field_file(".isoxml.zip", collection))
    found, _ = read_field(file, FRAME.datum)
    assert (len(found.holes), found.rows) == (1, ())
    assert shapely.Polygon(found.holes[0]).contains(shapely.LineString(POND[:2]))


def test_a_guidance_line_of_a_point_and_a_heading_is_an_ab_line(tmp_path: Path) -> None:
    (a, b) = read(tmp_path / "f.zip", pattern('C="2"', ' G="90.0"')).ab_line
    assert a == pytest.approx((20.0, 5.0), abs=1e-3)
    assert b == pytest.approx((120.0, 5.0), abs=1e-2)


@pytest.mark.parametrize(
    ("element", "words"),
    [
        (pattern('C="4"'), "guidance line Line of type 4"),
        (pattern(""), "guidance line Line without a type"),
        (pattern('C="2"'), "A+ line without a point or heading"),
        (area("9", "1"), "main field"),
        (area("10", "1"), "headland"),
        (line([(5.0, 5.0), (9.0, 9.0)], "4"), "sampling route"),
    ],
)
def test_what_is_no_obstacle_and_not_read_is_named_by_every_command(
    element: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "f.zip"
    assert read(file, element).left_out == f"f.zip: left out: {words}"
    assert main(["plan", "--field", str(file)]) == 0
    assert f"warning: f.zip: left out: {words}" in capsys.readouterr().err
    assert main(["plan", "convert", str(file), "--out", str(tmp_path / "f.geojson")]) == 0
    assert f"warning: f.zip: left out: {words}" in capsys.readouterr().err


def kml(*shapes: str) -> bytes:
    marks = "".join(f"<Placemark><name>it</name>{shape}</Placemark>" for shape in shapes)
    return f'<kml xmlns:gx="http://x"><Document>{marks}</Document></kml>'.encode()


def ring(points: list[tuple[float, float]]) -> str:
    text = " ".join(f"{lon:.9f},{lat:.9f}" for lon, lat in map(place, [*points, points[0]]))
    return f"<LinearRing><coordinates>{text}</coordinates></LinearRing>"


OUTER = f"<outerBoundaryIs>{ring(FIELD)}</outerBoundaryIs>"
INNER = f"<innerBoundaryIs>{ring(POND)}</innerBoundaryIs>"


@pytest.mark.parametrize(
    "shapes",
    [
        (f"<Polygon>{INNER}{OUTER}</Polygon>",),
        (f"<Polygon>{OUTER}</Polygon>", ring(POND)),
        (f"<MultiGeometry><Polygon>{OUTER}</Polygon>{ring(POND)}</MultiGeometry>",),
    ],
    ids=["hole first", "ring alone", "ring in a collection"],
)
def test_rings_of_kml_are_areas_wherever_they_stand(
    shapes: tuple[str, ...], tmp_path: Path
) -> None:
    file = tmp_path / "f.kml"
    file.write_bytes(kml(*shapes))
    found, _ = read_field(file, FRAME.datum)
    assert len(found.boundary) == 4
    assert [round(shapely.Polygon(hole).area) for hole in found.holes] == [100]


def test_kml_names_what_has_no_place_or_no_shape_and_points_that_plans_do_not_keep_off() -> None:
    lon_deg, lat_deg = place((30.0, 20.0))
    shapes = (
        f"<Polygon>{OUTER}</Polygon>",
        "<Point><coordinates/></Point>",
        "<Model><Location/></Model>",
        f"<Point><coordinates>{lon_deg},{lat_deg}</coordinates></Point>",
    )
    told = read_field_file("f.kml", kml(*shapes))["left_out"]
    assert told.startswith(
        "f.kml: left out: Point 'it' without coordinates, Model 'it' without coordinates; points "
        "without a kind: 1, taken for goals"
    )


def collect(*members: tuple[str, Any, dict[str, Any]]) -> bytes:
    outline = [[*map(place, FIELD), place(FIELD[0])]]
    features = [
        {
            "type": "Feature",
            "properties": properties,
            "geometry": {"type": shape, "coordinates": coordinates},
        }
        for shape, coordinates, properties in (("Polygon", outline, {}), *members)
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


FENCE = [place((20.0, 20.0)), place((30.0, 20.0))]


def test_lines_and_points_of_openstreetmap_that_stand_in_a_field_are_obstacles(
    tmp_path: Path,
) -> None:
    file = tmp_path / "f.geojson"
    file.write_bytes(
        collect(
            ("LineString", FENCE, {"barrier": "fence", "power": None}),
            ("Point", place((40.0, 10.0)), {"natural": "tree"}),
            ("LineString", [place((70.0, 0.0)), place((70.0, 40.0))], {"highway": "track"}),
        )
    )
    found, _ = read_field(file, FRAME.datum)
    areas_m2 = sorted(shapely.Polygon(hole).area for hole in found.holes)
    assert areas_m2 == pytest.approx([0.77, 10.77], rel=0.02)
    assert (found.rows, found.waypoints) == ((), ())
    assert found.left_out == "f.geojson: left out: obstacle beyond the boundary"


def test_a_line_in_a_field_that_says_nothing_is_named_as_the_row_that_it_is_taken_for(
    tmp_path: Path,
) -> None:
    file = tmp_path / "f.geojson"
    file.write_bytes(collect(("LineString", FENCE, {"name": "fence", "barrier": None})))
    found, _ = read_field(file, FRAME.datum)
    assert len(found.rows) == 1
    assert found.left_out == (
        "f.geojson: lines without a kind: 1, taken for crop rows, which are driven along; draw "
        "what stands there as an area"
    )


def test_rows_without_a_place_in_a_geopackage_are_counted(tmp_path: Path) -> None:
    outline = [[*map(list, map(place, FIELD)), list(place(FIELD[0]))]]
    collection = {
        "type": "Feature",
        "properties": {"kind": "boundary"},
        "geometry": {"type": "Polygon", "coordinates": outline},
    }
    file = tmp_path / "f.gpkg"
    file.write_bytes(write_geopackage(parse_features(collection, "f")))
    with sqlite3.connect(file) as database:
        database.executemany("INSERT INTO areas (kind) VALUES (?)", [("obstacle",)] * 2)
    database.close()
    told = read_field_file("f.gpkg", file.read_bytes())["left_out"]
    assert told == "f.gpkg: left out: 2 x a row of layer 'areas' without a place"
