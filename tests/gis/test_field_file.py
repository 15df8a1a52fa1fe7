"""Fields and plans as files: what is good comes back the same, what is bad is named."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest
import shapely

from agribot.app.field_work import plan_field_file
from agribot.autonomy.plan.coverage.area import FieldArea
from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.cli.main import main
from agribot.core.config import load
from agribot.core.fact_text import render
from agribot.core.facts import (
    AbLineClosed,
    AtNullIsland,
    Fact,
    FieldFar,
    FieldNeeded,
    FileBroken,
    KindUnknown,
    LatLonSwapped,
    LineShort,
    ManyPoints,
    MarginWrong,
    NoSuchField,
    NotDegrees,
    NotGeojson,
    NothingDrawn,
    NumbersExpected,
    ObstacleOutside,
    ObstaclesEverywhere,
    OptionOutside,
    OverlapWide,
    RingCrosses,
    RingShort,
    RowOutside,
    SeveralFields,
)
from agribot.core.geo import Datum, MapFrame
from agribot.description.loader import load_robot
from agribot.gis.field_file import read_field
from agribot.gis.formats.table import read_field_file
from agribot.gis.plan_file import SavedPlan, format_plan, read_plan
from tests.autonomy.plan.fields import REQUEST, ROWS, SHAPE, WITH_HOLE, certified
from tests.finding import refused

HERE = Datum(lat_deg=52.1, lon_deg=11.6)
FRAME = MapFrame(HERE)
OUTLINE = [(0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0)]
POND = [(10.0, 8.0), (14.0, 8.0), (14.0, 12.0), (10.0, 12.0)]


def lonlat(points: list[tuple[float, float]], frame: MapFrame = FRAME) -> list[list[float]]:
    places = [frame.geodetic_from_map(*point) for point in points]
    return [[lon_deg, lat_deg] for lat_deg, lon_deg, _ in places]


def polygon(points: list[tuple[float, float]], kind: str) -> dict[str, Any]:
    ring = lonlat(points)
    geometry = {"type": "Polygon", "coordinates": [[*ring, [*ring[0]]]]}
    return {"type": "Feature", "properties": {"kind": kind}, "geometry": geometry}


def line(points: list[tuple[float, float]], kind: str) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": lonlat(points)}
    return {"type": "Feature", "properties": {"kind": kind}, "geometry": geometry}


def field() -> dict[str, Any]:
    return {
        "type": "FeatureCollection",
        "features": [
            polygon(OUTLINE, "boundary"),
            polygon(POND, "obstacle"),
            line([(3.0, 3.0), (3.0, 17.0)], "row"),
            line([(0.0, 1.0), (30.0, 2.0)], "ab_line"),
        ],
    }


def written(tree: object, folder: Path) -> Path:
    path = folder / "field.geojson"
    path.write_text(json.dumps(tree))
    return path


def test_a_field_lies_where_its_file_says(tmp_path: Path) -> None:
    area, datum = read_field(written(field(), tmp_path), HERE)
    assert datum == HERE
    assert np.array(area.boundary) == pytest.approx(np.array(OUTLINE), abs=1e-3)
    assert {(round(x, 3), round(y, 3)) for x, y in area.holes[0]} == set(POND)
    assert np.array(area.rows[0]) == pytest.approx(np.array([(3, 3), (3, 17)]), abs=1e-3)
    assert np.array(area.ab_line) == pytest.approx(np.array([(0, 1), (30, 2)]), abs=1e-3)


def test_a_field_on_the_antimeridian_is_as_large_as_elsewhere(tmp_path: Path) -> None:
    frame = MapFrame(Datum(lat_deg=-16.5, lon_deg=179.9999))
    ring = lonlat([(-50.0, 0.0), (50.0, 0.0), (50.0, 40.0), (-50.0, 40.0)], frame)
    assert ring[0][0] > 179.0 and ring[1][0] < -179.0
    area, _ = read_field(written({"type": "Polygon", "coordinates": [ring]}, tmp_path))
    span_m = np.ptp(np.array(area.boundary), axis=0)
    assert span_m == pytest.approx((100.0, 40.0), abs=0.05)


def bad(change: Callable[[list[dict[str, Any]]], object]) -> dict[str, Any]:
    tree = copy.deepcopy(field())
    change(tree["features"])
    return tree


def ring_of(features: list[dict[str, Any]], number: int = 0) -> list[Any]:
    ring: list[Any] = features[number]["geometry"]["coordinates"][0]
    return ring


def swap_all(features: list[dict[str, Any]]) -> None:
    for position in ring_of(features):
        position.reverse()


def cross(features: list[dict[str, Any]]) -> None:
    ring = ring_of(features)
    ring[1], ring[2] = ring[2], ring[1]


IN_OTHER = "its coordinates are in {}; convert it to WGS-84 (EPSG:4326) first"
BAD: dict[str, tuple[Any, Fact | type[Fact]]] = {
    "crossing": (bad(cross), RingCrosses(ANY, ANY)),
    "swapped": (bad(swap_all), FieldFar(ANY, ANY, ANY, ANY, 20_000.0, ANY, "[11.6, 52.1]")),
    "nan": (bad(lambda f: ring_of(f)[1].__setitem__(0, math.nan)), NotDegrees(ANY, "nan")),
    "text": (bad(lambda f: ring_of(f)[1].__setitem__(0, "east")), NotDegrees(ANY, "'east'")),
    "nowhere": (bad(lambda f: ring_of(f).__setitem__(1, [0, 0])),
                AtNullIsland("'field.geojson' feature 0 ring 0 position 1")),
    "projected": (bad(lambda f: ring_of(f)[1].__setitem__(1, 5774000.0)), LatLonSwapped),
    "hole outside": (bad(lambda f: f.append(polygon([(40, 1), (44, 1), (44, 4)], "obstacle"))),
                     ObstacleOutside("field.geojson: obstacle 2", ANY)),
    "row outside": (bad(lambda f: f.append(line([(5, 5), (5, 33)], "row"))),
                    RowOutside("field.geojson", 2, 13.0, ANY)),
    "row in pond": (bad(lambda f: f.append(line([(12, 5), (12, 15)], "row"))),
                    RowOutside("field.geojson", 2, 4.0, ANY)),
    "point row": (bad(lambda f: f.append(line([(5, 5), (5, 5)], "row"))),
                  LineShort("field.geojson: row 2", 0.0, ANY, ANY)),
    "two outlines": (bad(lambda f: f.append(polygon(OUTLINE, "boundary"))),
                     SeveralFields("field.geojson", 2, "fields", "'field 1', 'field 2'",
                                   "field.geojson#field 1")),
    "none": ({"type": "FeatureCollection", "features": []}, NothingDrawn("'field.geojson'")),
    "kind": (bad(lambda f: f[2]["properties"].update(kind="hedge")),
             KindUnknown(ANY, "'hedge'", ANY)),
    "flat": (bad(lambda f: f[0]["geometry"].update(coordinates=[lonlat(POND[:2])])),
             RingShort(ANY, 2)),
    "many": (bad(lambda f: f[2]["geometry"].update(coordinates=lonlat(OUTLINE) * 6000)),
             ManyPoints("field.geojson", ANY, 20_000)),
    "margin of text": (bad(lambda f: f[0]["properties"].update(margin_m="wide")),
                       MarginWrong(ANY, "'wide'", 10.0)),
    "margin": (bad(lambda f: f[0]["properties"].update(margin_m=-1)), MarginWrong(ANY, "-1", 10.0)),
    "other coordinates": (
        {**field(), "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::4267"}}},
        FileBroken(ANY, IN_OTHER.format("urn:ogc:def:crs:EPSG::4267"), is_advised=True)),
    "other coordinates elsewhere": (
        {**field(), "crs": {"type": "link", "properties": {"href": "http://a/25832"}}},
        FileBroken(ANY, IN_OTHER.format("http://a/25832"), is_advised=True)),
    "other coordinates in a word": ({**field(), "crs": "EPSG:25832"}, FileBroken),
    "ab lines": (bad(lambda f: f.append(line([(0, 1), (3, 1)], "ab_line"))),
                 SeveralFields(ANY, 2, "lines", "'line 1', 'line 2'", ANY)),
    "ab ring": (bad(lambda f: f.__setitem__(3, line([(0, 1), (9, 1), (0, 1)], "ab_line"))),
                AbLineClosed("field.geojson", ANY)),
    "all pond": (bad(lambda f: f.append(polygon([(-1, -1), (31, -1), (31, 21), (-1, 21)],
                                                "obstacle"))),
                 ObstaclesEverywhere("field.geojson")),
    "no geojson": ([1, 2], NotGeojson("the file", "list")),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_broken_field_is_refused_with_what_and_where(name: str, tmp_path: Path) -> None:
    tree, why = BAD[name]
    with refused(why):
        read_field(written(tree, tmp_path), HERE)


def area_m2(area: FieldArea) -> float:
    return float(shapely.Polygon(area.boundary, area.holes).area)


def with_ring(points: list[tuple[float, float]]) -> dict[str, Any]:
    return bad(lambda f: f.__setitem__(0, polygon(points, "boundary")))


def with_obstacle(points: list[tuple[float, float]]) -> dict[str, Any]:
    return bad(lambda f: f.__setitem__(1, polygon(points, "obstacle")))


AS_DRAWN = {
    "a spike of no width": (
        with_ring([*OUTLINE[:2], (30.0, 10.0), (45.0, 10.0), (30.0, 10.0), *OUTLINE[2:]]), 584.0),
    "a spike into the field": (
        with_ring([*OUTLINE[:2], (30.0, 10.0), (20.0, 10.0), (30.0, 10.0), *OUTLINE[2:]]), 584.0),
    "a ring that touches itself": (
        with_ring([(0, 0), (15, 0), (20, 5), (25, 5), (25, 2), (20, 5), (15, 0), (30, 0), (30, 20),
                   (0, 20)]), 600.0 - 16.0 - 7.5),
    "a tree in the hedge": (with_obstacle([(28, 4), (32, 4), (32, 8), (28, 8)]), 592.0),
    "a house at the edge": (with_obstacle([(26, 4), (30, 4), (30, 8), (26, 8)]), 584.0),
    "a house beyond the edge": (with_obstacle([(30, 4), (34, 4), (34, 8), (30, 8)]), 600.0),
    "a pond that touches in a point": (with_obstacle([(30, 4), (26, 6), (26, 2)]), 592.0),
    "a pond of two loops": (
        with_obstacle([(10, 5), (14, 5), (12, 8), (14, 11), (10, 11), (12, 8)]), 588.0),
}  # fmt: skip


@pytest.mark.parametrize("name", AS_DRAWN)
def test_a_field_as_people_draw_it_is_the_ground_that_they_meant(name: str, tmp_path: Path) -> None:
    """Each of these was refused, with "put its corners in order" or "lies outside"."""
    tree, ground_m2 = AS_DRAWN[name]
    area, _ = read_field(written(tree, tmp_path), HERE)
    assert area_m2(area) == pytest.approx(ground_m2, abs=0.05)
    assert shapely.Polygon(area.boundary, area.holes).is_valid
    assert not area.left_out


def test_what_an_obstacle_cuts_off_is_named(tmp_path: Path) -> None:
    ditch = with_obstacle([(20, -1), (21, -1), (21, 21), (20, 21)])
    area, _ = read_field(written(ditch, tmp_path), HERE)
    assert area_m2(area) == pytest.approx(400.0, abs=0.02)
    assert "a part of 180.0 m2, the largest at latitude 52.1" in area.left_out
    assert "cut off from the rest of the field" in area.left_out


def test_of_a_parcel_of_several_parts_the_largest_is_the_field_and_the_others_are_named(
    tmp_path: Path,
) -> None:
    """As a cadastre exports every parcel."""
    small = [(40.0, 0.0), (50.0, 0.0), (50.0, 20.0), (40.0, 20.0)]
    parts = [[[*lonlat(ring), lonlat(ring)[0]]] for ring in (small, OUTLINE)]
    parcel = {"type": "MultiPolygon", "coordinates": parts}
    feature = {"type": "Feature", "properties": {}, "geometry": parcel}
    for tree in (parcel, feature, {"type": "FeatureCollection", "features": [feature]}):
        area, _ = read_field(written(tree, tmp_path), HERE)
        assert area_m2(area) == pytest.approx(600.0, abs=0.02)
        assert "left out: a part of the boundary of 200 m2" in area.left_out


@pytest.mark.parametrize(
    ("named", "chosen", "ground_m2"),
    [({}, "part 2", 200.0), ({"name": "North"}, "North part 2", 200.0), ({}, "part 3", 50.0)],
)
def test_every_part_of_a_parcel_is_a_field_by_its_name(
    named: dict[str, str], chosen: str, ground_m2: float, tmp_path: Path
) -> None:
    """With the obstacle that lies in it; only the largest could be planned."""
    shed = [(42.0, 4.0), (44.0, 4.0), (44.0, 6.0), (42.0, 6.0)]
    rings = [OUTLINE]
    rings += [[(x, 0.0), (x + wide_m, 0.0), (x + wide_m, 20.0), (x, 20.0)]
              for x, wide_m in ((60.0, 2.5), (40.0, 10.0))]  # fmt: skip
    parts = [[[*lonlat(ring), lonlat(ring)[0]]] for ring in rings]
    parcel = {"type": "MultiPolygon", "coordinates": parts}
    features = [
        {"type": "Feature", "properties": named, "geometry": parcel},
        polygon(shed, "obstacle"),
    ]
    path = written({"type": "FeatureCollection", "features": features}, tmp_path)
    whole, _ = read_field(path, HERE)
    assert area_m2(whole) == pytest.approx(600.0, abs=0.02)
    assert f"choose it behind the name of the file: '#{chosen}'" in whole.left_out
    area, _ = read_field(Path(f"{path}#{chosen}"), HERE)
    shed_m2 = 4.0 if chosen.endswith("2") else 0.0
    assert area_m2(area) == pytest.approx(ground_m2 - shed_m2, abs=0.05)
    with refused(NoSuchField(ANY, "part 9", ANY, ANY)):
        read_field(Path(f"{path}#part 9"), HERE)


def test_rows_of_several_lines_and_features_without_a_place_are_read_as_the_page_reads_them(
    tmp_path: Path,
) -> None:
    tree = field()
    lines = {"type": "MultiLineString", "coordinates": [lonlat([(x, 3), (x, 17)]) for x in (3, 4)]}
    tree["features"][2]["geometry"] = lines
    tree["features"].append({"type": "Feature", "properties": {}, "geometry": None})
    area, _ = read_field(written(tree, tmp_path), HERE)
    assert len(area.rows) == 2
    assert area.left_out == "field.geojson: left out: a feature without a place"
    page = read_field_file("field.geojson", json.dumps(tree).encode())
    assert [f["properties"]["kind"] for f in page["features"]].count("row") == 2


def test_an_ab_line_of_many_points_leads_from_its_first_to_its_last(tmp_path: Path) -> None:
    recorded = [(0.0, 1.0), (10.0, 1.4), (20.0, 1.6), (30.0, 2.0)]
    tree = bad(lambda f: f.__setitem__(slice(2, 4), [line(recorded, "ab_line")]))
    area, _ = read_field(written(tree, tmp_path), HERE)
    plan, certificate = certified(area)
    assert certificate.ok
    assert plan.swath_yaw_rad == pytest.approx(math.atan2(1.0, 30.0), abs=1e-4)
    assert not plan.warnings
    bent = msgspec.structs.replace(area, ab_line=((0.0, 1.0), (15.0, 4.5), (30.0, 2.0)))
    assert any("up to 3.00 m beside the straight line" in w for w in certified(bent)[0].warnings)


@pytest.mark.parametrize(("asked_m", "kept_m"), [(None, 0.8), (0.3, 0.3)])
def test_a_plan_keeps_the_margin_of_its_field_unless_it_is_asked_for_another(
    asked_m: float | None, kept_m: float, tmp_path: Path
) -> None:
    tree = copy.deepcopy(field())
    tree["features"][0]["properties"].update(margin_m=0.8)
    config = load("rows-10x12", [f"field.datum={{lat_deg={HERE.lat_deg}, lon_deg={HERE.lon_deg}}}"])
    saved, certificate = plan_field_file(
        written(tree, tmp_path), config, load_robot("agribot"), None, asked_m
    )
    assert saved.request.margin_m == kept_m and certificate.ok
    shape = measure_footprint(load_robot("agribot"), saved.request.implement_width_m)
    edge = shapely.LinearRing(saved.area.boundary)
    way = shapely.MultiLineString([leg.xy_map_m for leg in saved.plan.legs])
    assert edge.distance(way) > kept_m + shape.half_width_m - 0.02


def test_coordinates_that_can_only_be_swapped_say_so(tmp_path: Path) -> None:
    tree = {"type": "Polygon", "coordinates": [[[21.1, 172.7], [21.1, 172.8], [21.2, 172.8]]]}
    with refused(LatLonSwapped(ANY, 172.7, "[172.7, 21.1]")):
        read_field(written(tree, tmp_path))


def test_a_saved_plan_is_certified_again_after_reading(tmp_path: Path) -> None:
    for area, request in ((WITH_HOLE, REQUEST),):
        plan, certificate = certified(area, request)
        path = tmp_path / "plan.geojson"
        path.write_text(format_plan(SavedPlan(plan, area, request, HERE), certificate))
        saved = read_plan(path)
        assert saved.request == request
        for before, after in zip(plan.legs, saved.plan.legs, strict=True):
            assert (before.kind, before.row) == (after.kind, after.row)
            assert after.xy_map_m == pytest.approx(before.xy_map_m, abs=2e-4)
        again = certify_plan(saved.plan, saved.area, SHAPE, saved.request)
        assert again.ok, again.problems
        assert again.coverage_ratio == pytest.approx(certificate.coverage_ratio, abs=1e-3)


def test_verify_refuses_a_plan_that_was_changed_by_hand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, path = written(bad(lambda f: f.pop(2)), tmp_path), tmp_path / "plan.geojson"
    wanted = ["plan", "--field", str(source), "--implement-width", "1.0", "--out", str(path)]
    assert main(wanted) == 0
    assert main(["plan", "verify", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["ok"] is True
    tree = json.loads(path.read_text())
    leg = next(f for f in tree["features"] if f["properties"]["kind"] == "leg:headland")
    leg["geometry"]["coordinates"][-1][0] += 1e-3  # seventy metres East
    path.write_text(json.dumps(tree))
    assert main(["plan", "verify", str(path), "--json"]) == 1
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {problem["rule"] for problem in told["problems"]} >= {"path", "footprint"}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (["--implement-width", "nan"], OptionOutside("--implement-width", math.nan, 0.05, 50.0)),
        (["--implement-width", "0"], OptionOutside("--implement-width", 0.0, 0.05, 50.0)),
        (["--implement-width", "1", "--start", "11.6"], NumbersExpected("--start", "11.6", 2)),
        (
            ["--implement-width", "1", "--swath-angle", "north"],
            NumbersExpected("--swath-angle", "north", 1),
        ),
        (["--implement-width", "1", "--overlap", "2"], OverlapWide(2.0, 1.0)),
    ],
)
def test_wrong_use_is_told_in_one_line(
    change: list[str], why: Fact, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = written(bad(lambda f: f.pop(2)), tmp_path)
    assert main(["plan", "--field", str(source), *change]) == 2
    told = capsys.readouterr().err.strip()
    assert render(why) in told
    assert "\n" not in told


def test_a_plan_is_made_for_the_robots_own_tool_and_a_wider_one_is_told_what_it_leaves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, path = written(bad(lambda f: f.pop(2)), tmp_path), tmp_path / "plan.geojson"
    assert main(["plan", "--field", str(source), "--out", str(path)]) == 0
    assert json.loads(path.read_text())["agribot"]["request"]["implement_width_m"] == pytest.approx(
        1.08
    )
    assert "warning" not in capsys.readouterr().err
    assert (
        main(["plan", "--field", str(source), "--implement-width", "1.5", "--out", str(path)]) == 0
    )
    warning = capsys.readouterr().err.splitlines()[0]
    assert "m2 between the passes stay unworked" in warning
    assert "that of agribot works 1.08 m" in warning
    assert main(["plan", "verify", str(path)]) == 0
    assert capsys.readouterr().err.splitlines()[0] == warning
    assert main(["plan"]) == 2
    assert render(FieldNeeded()) in capsys.readouterr().err


def test_a_field_with_rows_round_trips_through_the_plan(tmp_path: Path) -> None:
    request = REQUEST.__class__(implement_width_m=0.8, headland_passes=0)
    plan, certificate = certified(ROWS, request)
    path = tmp_path / "plan.geojson"
    path.write_text(format_plan(SavedPlan(plan, ROWS, request, HERE), certificate))
    saved = read_plan(path)
    assert np.array(saved.area.rows) == pytest.approx(np.array(ROWS.rows), abs=2e-4)
    assert certify_plan(saved.plan, saved.area, SHAPE, saved.request).ok
