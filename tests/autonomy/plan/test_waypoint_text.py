from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agribot.autonomy.plan.ways.waypoint_text import parse_waypoints
from agribot.core.errors import MissionError

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
    ("text", "complaint"),
    [
        ("", "f line 1: expected a header"),
        ("x,y\n1,2\n", "expected a header with 'lat' and 'lon', got 'x,y'"),
        ("lat,lon\n", "holds no waypoints"),
        ("lat,lon\n1,2\nfast,2\n", "f line 3: 'fast' is not a number"),
        ('lat,lon\n"21,5",72\n', "f line 2: '21,5' is not a number of degrees; write a point"),
        ("lat;lon\n1,000,5;2\n", "f line 2: '1,000,5' is not a number"),
        ("lat,lon\n1,nan\n", "f line 2: 'nan' is not a number"),
        ("lat,lon\n1\n", "f line 2: 1 values"),
        ("lat,lon\n1,2\n0.0,0\n", "f line 3: latitude 0, longitude 0 is what devices write"),
        ("lat,lon\n91,2\n", "f line 2: latitude 91.0 is outside"),
        ("lat,lon\n1,181\n", "f line 2: longitude 181.0 is outside"),
        ('{"type":\n "Point",}', "f line 2 is not valid JSON"),
        ("[1, 2]", "expected a GeoJSON object, got list"),
        ('{"type": "Polygon", "coordinates": []}', "geometry 'Polygon' gives no waypoints"),
        ('{"type": "FeatureCollection"}', "needs a list 'features'"),
        ('{"type": "LineString", "coordinates": [[1, 2], [3]]}', r"position 1: \[3\] is not"),
        ('{"type": "LineString", "coordinates": 3}', "must be a list"),
        ('{"type": "Point", "coordinates": [true, 2]}', "True is not a number"),
        (f'{{"type": "Point", "coordinates": [{10**400}, 2]}}', "0 is not a number"),
        ('{"type": "Feature", "geometry": null}', "holds no waypoints"),
        ('{"type": "MultiPoint", "coordinates": []}', "holds no waypoints"),
    ],
)
def test_every_mistake_is_named_with_its_place(text: str, complaint: str) -> None:
    with pytest.raises(MissionError, match=complaint):
        parse_waypoints(text, "f")


@given(text=st.text(max_size=60))
def test_any_text_gives_points_or_one_clear_error(text: str) -> None:
    try:
        assert parse_waypoints(text, "f")
    except MissionError as error:
        assert str(error).startswith("f")
