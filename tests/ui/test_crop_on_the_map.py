"""Plans of the page keep off the crop on the map until somebody says that it is gone."""

from __future__ import annotations

from typing import Any

import pytest

from agribot.core.errors import MissionError
from agribot.core.fact_text import render
from agribot.core.facts import ObstacleOutside, WayCrossesCrop

pytest.importorskip("starlette")
from agribot.app.field_work import read_work
from agribot.autonomy.plan.mission.route import Route
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import load
from agribot.core.geo import MapFrame
from agribot.description.loader import load_robot
from agribot.ui import wire
from agribot.ui.ground import field_of
from agribot.ui.server.planning import Made, make_plan

CONFIG, ROBOT = load("farm"), load_robot("agribot")
ROWS = field_of(CONFIG, lay_rows(CONFIG.field)).crop_map_m
ALL = [point for row in ROWS for point in row]
WEST, SOUTH = (min(axis) - 4.0 for axis in zip(*ALL, strict=True))
EAST, NORTH = (max(axis) + 4.0 for axis in zip(*ALL, strict=True))
AROUND = [(WEST, SOUTH), (EAST, SOUTH), (EAST, NORTH), (WEST, NORTH)]
OBSTACLE = {"properties": {"kind": "obstacle"}}


def feature(kind: str, points: list[wire.Vec2]) -> dict[str, Any]:
    frame = MapFrame(CONFIG.field.datum)
    places = [frame.geodetic_from_map(*point) for point in points]
    lonlat = [[lon_deg, lat_deg] for lat_deg, lon_deg, _ in places]
    line = {"type": "LineString", "coordinates": lonlat}
    area = {"type": "Polygon", "coordinates": [[*lonlat, lonlat[0]]]}
    shape = area if kind == "boundary" else line
    return {"type": "Feature", "properties": {"kind": kind}, "geometry": shape}


def plan(*features: dict[str, Any], is_crop_gone: bool = False) -> Made:
    field = {"type": "FeatureCollection", "features": list(features)}
    return make_plan(wire.PlanWish(field=field, is_crop_gone=is_crop_gone), CONFIG, ROBOT, ROWS)


def wheel_clearance_m(made: Made) -> float | None:
    assert made.answer.ok and made.answer.certificate, made.answer.reasons
    clearance_m: float | None = made.answer.certificate["wheel_row_clearance_m"]
    return clearance_m


def test_a_boundary_drawn_over_the_crop_is_worked_around_it_and_the_map_keeps_it() -> None:
    made = plan(feature("boundary", AROUND))
    assert (wheel_clearance_m(made) or 0.0) >= 0.1
    assert made.field is not None
    assert len(made.field.crop_map_m) == len(ROWS)
    work = read_work(made.text, "the plan", CONFIG, ROBOT)
    assert len(work.area.crop) == len(ROWS), "a run that goes on keeps off it as well"


def test_a_robot_between_rows_is_not_led_across_them_into_a_field_beside_them() -> None:
    beside = [(EAST, SOUTH), (EAST + 12.0, SOUTH), (EAST + 12.0, NORTH), (EAST, NORTH)]
    (x0_m, y0_m), *_, (x1_m, y1_m) = ROWS[0]
    in_row = ((x0_m + x1_m) / 2.0, (y0_m + y1_m) / 2.0, 0.0)
    made = plan(feature("boundary", beside))
    with pytest.raises(MissionError) as refused:
        read_work(made.text, "the plan", CONFIG, ROBOT).plan_from(in_row)
    assert isinstance(refused.value.fact, WayCrossesCrop)
    gone = plan(feature("boundary", beside), is_crop_gone=True)
    read_work(gone.text, "the plan", CONFIG, ROBOT).plan_from(in_row)


def test_crop_that_somebody_says_is_gone_is_planned_over_and_leaves_the_map() -> None:
    made = plan(feature("boundary", AROUND), is_crop_gone=True)
    assert wheel_clearance_m(made) is None
    assert made.field is not None and made.field.crop_map_m == []
    assert made.is_crop_gone


def test_rows_that_are_drawn_as_they_stand_are_worked_and_the_others_kept_off() -> None:
    rows = [feature("row", row) for row in ROWS[:2]]
    made = plan(feature("boundary", AROUND), *rows)
    work = read_work(made.text, "the plan", CONFIG, ROBOT)
    assert (len(work.area.rows), len(work.area.crop)) == (2, len(ROWS) - 2)
    assert made.field is not None and len(made.field.crop_map_m) == len(ROWS)


def test_the_time_of_a_plan_is_that_of_its_mission_with_ramps_and_turns() -> None:
    """It was the length over the speed: 6:18 min for a mission that took 7:53."""
    beside = [(EAST, SOUTH), (EAST + 12.0, SOUTH), (EAST + 12.0, NORTH), (EAST, NORTH)]
    made = plan(feature("boundary", beside))
    work = read_work(made.text, "the plan", CONFIG, ROBOT)
    x_m, y_m = work.legs[0].xy_map_m[0].tolist()
    path = work.plan_from((x_m, y_m, 0.0))
    mission = Route(path, [row.index for row in work.rows], CONFIG.mission, ())
    assert made.answer.time_s == pytest.approx(mission.time_left_s, abs=5.0)
    assert made.answer.length_m is not None and made.answer.time_s is not None
    assert made.answer.time_s > 1.1 * made.answer.length_m / CONFIG.mission.speed_mps


def test_a_fault_of_a_field_is_a_place_on_the_map_and_no_degrees_in_the_text() -> None:
    pond = [(WEST - 9.0, SOUTH), (WEST - 7.0, SOUTH), (WEST - 7.0, NORTH), (WEST - 9.0, NORTH)]
    made = plan(feature("boundary", AROUND), {**feature("boundary", pond), **OBSTACLE})
    [reason] = made.answer.reasons
    assert reason.text == render(ObstacleOutside("the field: obstacle 1"))
    assert reason.at_map_m == pytest.approx((WEST - 8.0, (SOUTH + NORTH) / 2.0), abs=0.1)
