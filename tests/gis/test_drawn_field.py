"""The field that a robot draws: as wide as a plan needs that knows as little of its place."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from agribot.app.field_work import plan_field_file
from agribot.core.config import load
from agribot.core.geo import Datum
from agribot.core.messages import FloatArray
from agribot.description.loader import load_robot
from agribot.gis.drawn_field import BESIDE_TRACK_M, DrawnRow, format_drawn_field
from agribot.gis.field_file import read_field

HERE = Datum(lat_deg=52.1, lon_deg=11.6)
CONFIG = load("rows-10x12", [f"field.datum={{lat_deg={HERE.lat_deg}, lon_deg={HERE.lon_deg}}}"])
ENDS_M = (-0.9, 8.9)  # of the track, past the ends of rows from 0 to 8 m


def draw(path: Path, std_m: float, unsure_m: float, bulge_m: float = 0.0) -> FloatArray:
    """Four rows 1 m apart that bend aside in their middle, driven up and down; its track."""
    rows, track = [], list[tuple[float, float]]()
    for number in range(4):
        y_m = -1.0 * number
        line = [(0.0, y_m), (4.0, y_m + bulge_m), (8.0, y_m)]
        rows.append(DrawnRow(line, std_m))
        driven = [(ENDS_M[0], y_m), *line, (ENDS_M[1], y_m)]
        track += driven if number % 2 == 0 else driven[::-1]
    path.write_text(format_drawn_field(rows, np.array(track), HERE, unsure_m))
    return np.array(track)


@pytest.mark.parametrize("unsure_m", [0.0, 1.2])
def test_the_boundary_lies_as_far_beside_the_track_as_the_fence_keeps_the_robot_off_it(
    unsure_m: float, tmp_path: Path
) -> None:
    track = draw(tmp_path / "field.geojson", 0.1, unsure_m)
    area, _ = read_field(tmp_path / "field.geojson", HERE)
    kept_m = max(unsure_m, 0.1)
    beside_m = BESIDE_TRACK_M + kept_m + min(kept_m, 0.5)
    edge, driven = shapely.LinearRing(area.boundary), shapely.LineString(track)
    assert edge.distance(driven) == pytest.approx(beside_m, abs=0.06)
    assert shapely.Polygon(area.boundary).area < driven.buffer(beside_m + 0.1).area
    assert area.margin_m == pytest.approx(0.05 + kept_m)


@pytest.mark.parametrize("unsure_m", [0.0, 0.4, 1.2, 3.0])
def test_what_was_drawn_can_be_planned_with_the_margin_that_it_tells(
    unsure_m: float, tmp_path: Path
) -> None:
    draw(tmp_path / "field.geojson", 0.1, unsure_m)
    robot = load_robot("agribot")
    saved, certificate = plan_field_file(tmp_path / "field.geojson", CONFIG, robot, None)
    assert certificate.ok
    assert sum(leg.kind == "row" for leg in saved.plan.legs) == 4


@pytest.mark.parametrize(
    ("std_m", "bulge_m", "corners"),
    [(0.014, 0.01, 2), (0.014, 0.05, 3), (0.2, 0.05, 2), (0.2, 0.15, 3), (math.nan, 0.05, 3)],
)
def test_a_row_bends_on_paper_only_where_the_robot_knows_its_place_better_than_that(
    std_m: float, bulge_m: float, corners: int, tmp_path: Path
) -> None:
    draw(tmp_path / "field.geojson", std_m, 0.0, bulge_m)
    area, _ = read_field(tmp_path / "field.geojson", HERE)
    assert [len(row) for row in area.rows] == [corners] * 4
    told = [feature["properties"].get("std_m") for feature in
            json.loads((tmp_path / "field.geojson").read_text())["features"]][1:]  # fmt: skip
    assert told == [None if math.isnan(std_m) else std_m] * 4
