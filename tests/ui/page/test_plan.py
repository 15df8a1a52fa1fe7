"""The field that is drawn: files in and out, every corner where it was."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from agribot.core.geo import Datum, MapFrame
from agribot.gis.formats.table import WRITERS, read_field_file, write_field_file
from tests import nightly
from tests.ui.page.conftest import OpenPage
from tests.ui.page.fake_answers import ROBOT, UNWORKED
from tests.ui.page.fake_robot import DATUM
from tests.ui.page.fake_server import FakeServer
from tests.waiting import wait_for

FRAME = MapFrame(Datum(lat_deg=DATUM.lat_deg, lon_deg=DATUM.lon_deg))
CENTIMETRE_M = 0.01
BOUNDARY = [(0.0, 0.0), (30.123, 0.5), (30.0, 20.777), (0.0, 20.0)]
POND = [(10.0, 8.0), (14.0, 8.0), (14.0, 12.0), (10.0, 12.0)]
ROW = [(3.0, 3.0), (3.004, 17.0)]
GOAL = [(5.0, 6.0)]
DRAWN = {"boundary": BOUNDARY, "obstacle": POND, "row": ROW, "waypoint": GOAL}
LABELS = {
    ".geojson": "GeoJSON",
    ".gpkg": "GeoPackage",
    ".kml": "KML",
    ".kmz": "KMZ",
    ".gpx": "GPX",
    ".shp.zip": "Shapefile",
    ".isoxml.zip": "ISOXML",
}


def lonlat(points: list[tuple[float, float]]) -> list[list[float]]:
    places = [FRAME.geodetic_from_map(*point) for point in points]
    return [[lon_deg, lat_deg] for lat_deg, lon_deg, _ in places]


def feature(kind: str, geometry: str, coordinates: Any) -> dict[str, Any]:
    shape = {"type": geometry, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"kind": kind}, "geometry": shape}


def ring(points: list[tuple[float, float]]) -> list[list[float]]:
    line = lonlat(points)
    return [*line, line[0]]


FIELD = {
    "type": "FeatureCollection",
    "features": [
        feature("boundary", "Polygon", [ring(BOUNDARY), ring(POND)]),
        feature("row", "LineString", lonlat(ROW)),
        feature("waypoint", "Point", lonlat(GOAL)[0]),
    ],
}


@pytest.fixture
def page_size() -> tuple[int, int]:
    return 900, 600


@pytest.fixture
def page(open_page: OpenPage, server: FakeServer) -> Page:
    server.robot.mode = "paused"  # the map is not drawn anew for a robot that stands
    return open_page("plan", query="off=scene,camera")


def drawn(collection: dict[str, Any]) -> dict[str, list[tuple[float, float]]]:
    """The points of each kind in the map, as drawn on the page: obstacles are shapes of their own.

    A ring is without its repeated point.
    """
    found: dict[str, list[tuple[float, float]]] = {}
    for each in collection["features"]:
        coordinates = each["geometry"]["coordinates"]
        lines = {"Polygon": coordinates, "LineString": [coordinates], "Point": [[coordinates]]}
        for number, line in enumerate(lines[each["geometry"]["type"]]):
            points = [FRAME.map_from_geodetic(lat, lon, 0.0)[:2] for lon, lat in line]
            kind = "obstacle" if number else each["properties"]["kind"]
            is_ring = each["geometry"]["type"] == "Polygon"
            found[kind] = points[:-1] if is_ring else points
    return found


def check_drawn(collection: dict[str, Any]) -> None:
    found = drawn(collection)
    assert found.keys() == DRAWN.keys()
    for kind, points in DRAWN.items():
        assert len(found[kind]) == len(points), kind
        for point in points:
            assert min(math.dist(point, other) for other in found[kind]) < CENTIMETRE_M, kind


def test_the_page_offers_every_format_that_the_server_knows() -> None:
    other_names = {".json"}  # of GeoJSON
    assert LABELS.keys() == WRITERS.keys() - other_names


def import_and_export(page: Page, server: FakeServer, ending: str, folder: Path) -> None:
    file = folder / f"north{ending}"
    file.write_bytes(write_field_file(ending, FIELD))
    page.get_by_label("Field file").set_input_files(file)
    expect(page.locator(".side")).to_contain_text("1 obstacle")
    server.written.clear()
    page.get_by_role("button", name="Check plan").click()
    wait_for(lambda: "plan" in server.written, "a plan to check")
    check_drawn(server.written["plan"]["field"])
    assert server.written["plan"]["implement_width_m"] == ROBOT.tool_width_m
    expect(page.locator(".side")).to_contain_text(UNWORKED)
    page.get_by_role("button", name="Export").click()
    with page.expect_download() as asked:
        page.get_by_role("dialog").get_by_role("button", name=LABELS[ending], exact=True).click()
    name = asked.value.suggested_filename
    assert name == f"field{ending}"
    check_drawn(read_field_file(name, asked.value.path().read_bytes()))
    page.get_by_role("button", name="Undo").click()
    expect(page.locator(".side")).not_to_contain_text("1 obstacle")


@nightly.by_day(
    "tests/ui/page/test_drawing.py::test_a_field_file_is_imported_drawn_and_exported_again",
    "tests/ui/test_rest.py::test_field_files_of_other_programs_keep_every_vertex",
    "tests/ui/test_rest.py::test_a_field_is_exported_in_the_format_that_is_asked_for",
)
def test_field_files_are_imported_drawn_and_exported_again(
    page: Page, server: FakeServer, tmp_path: Path
) -> None:
    for ending in LABELS:
        import_and_export(page, server, ending, tmp_path)
