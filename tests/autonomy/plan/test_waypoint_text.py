from __future__ import annotations

import json
from unittest.mock import ANY

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.autonomy.plan.ways.waypoint_text import parse_waypoints
from agribot.core.errors import MissionError
from agribot.core.facts import (
    AtNullIsland,
    Fact,
    GeometryUnfit,
    HeaderMissing,
    JsonBroken,
    LatitudeOutside,
    ListMissing,
    LongitudeOutside,
    NotDegrees,
    NotGeojson,
    NotPosition,
    NotPositions,
    NoWaypointsIn,
    ValuesMissing,
)
from tests.finding import refused

lat_lon = st.tuples(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0)).filter(any)


@given(points=st.lists(lat_lon, min_size=1, max_size=8))
def test_csv_and_geojson_give_back_the_points_written(points: list[tuple[float, float]]) -> None:
    rows = "".join(f"\n{lat!r},{lon!r}" for lat, lon in points)
    assert parse_waypoints(f"lat,lon{rows}\n", "list.csv") == tuple(points)
    line = {"type": "LineString", "coordinates": [[lon, lat, 7.0] for lat, lon in points]}
    assert parse_waypoints(json.dumps(line), "list.geojson") == tuple(points)


def test_features_are_read_in_order_with_points_and_lines_mixed() -> None:
    def feature(kind: str, coordinates: object) -> dict[str, object]:
        geometry = {"type": kind, "coordinates": coordinates}
        return {"type": "Feature", "properties": {}, "geometry": geometry}

    features = [feature("Point", [72.1, 21.1]), feature("LineString", [[72.2, 21.2], [72.3, 21.3]])]
    text = json.dumps({"type": "FeatureCollection", "features": features})
    assert parse_waypoints(text, "f") == ((21.1, 72.1), (21.2, 72.2), (21.3, 72.3))


def test_columns_may_stand_anywhere_and_blank_lines_are_skipped() -> None:
    text = "\ufeffname,Longitude,Latitude\nend,72.5,21.5\n\nhome,72.6,21.6\n"
    assert parse_waypoints(text, "f.csv") == ((21.5, 72.5), (21.6, 72.6))


@pytest.mark.parametrize(
    "text",
    [
        "name;Latitude;Longitude\nend;21,5;72,5\nhome;21,6;72,6\n",
        "name;lat;lon\nend;21.5;72.5\nhome, where it stands;21.6;72.6\n",
        "name\tlat\tlon\nend\t21,5\t72.5\nhome\t21,6\t72,6\n",
    ],
)
def test_a_spreadsheet_may_separate_by_semicolons_or_tabs_and_write_decimal_commas(
    text: str,
) -> None:
    assert parse_waypoints(text, "f.csv") == ((21.5, 72.5), (21.6, 72.6))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", HeaderMissing("f", "")),
        ("x,y\n1,2\n", HeaderMissing("f", "x,y")),
        ("lat,lon\n", NoWaypointsIn("f")),
        ("lat,lon\n1,2\nfast,2\n", NotDegrees("f line 3", "'fast'")),
        ('lat,lon\n"21,5",72\n', NotDegrees("f line 2", "'21,5'", has_comma=True)),
        ("lat;lon\n1,000,5;2\n", NotDegrees("f line 2", "'1,000,5'")),
        ("lat,lon\n1,nan\n", NotDegrees("f line 2", "'nan'")),
        ("lat,lon\n1\n", ValuesMissing("f line 2", 1, 2)),
        ("lat,lon\n1,2\n0.0,0\n", AtNullIsland("f line 3")),
        ("lat,lon\n91,2\n", LatitudeOutside("f line 2", 91.0)),
        ("lat,lon\n1,181\n", LongitudeOutside("f line 2", 181.0)),
        ('{"type":\n "Point",}', JsonBroken("f", ANY, 2)),
        ("[1, 2]", NotGeojson("f", "list")),
        ('{"type": "Polygon", "coordinates": []}', GeometryUnfit("f", "'Polygon'", "waypoints")),
        ('{"type": "FeatureCollection"}', ListMissing("f", "FeatureCollection", "features")),
        (
            '{"type": "LineString", "coordinates": [[1, 2], [3]]}',
            NotPosition("f position 1", "[3]"),
        ),
        ('{"type": "LineString", "coordinates": 3}', NotPositions("f")),
        ('{"type": "Point", "coordinates": [true, 2]}', NotDegrees("f", "True")),
        (f'{{"type": "Point", "coordinates": [{10**400}, 2]}}', NotDegrees("f", "1" + 79 * "0")),
        ('{"type": "Feature", "geometry": null}', NoWaypointsIn("f")),
        ('{"type": "MultiPoint", "coordinates": []}', NoWaypointsIn("f")),
    ],
)
def test_every_mistake_is_named_with_its_place(text: str, why: Fact) -> None:
    with refused(why):
        parse_waypoints(text, "f")


@given(text=st.text(max_size=60))
def test_any_text_gives_points_or_one_clear_error(text: str) -> None:
    try:
        assert parse_waypoints(text, "f")
    except MissionError as error:
        named = dict(error.fact.values)
        assert str(named.get("where") or named["file"]).startswith("f")
