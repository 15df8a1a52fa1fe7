"""Whole fields: everything is worked, nothing outside is touched, and refusals say why."""

from __future__ import annotations

import math
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest
import shapely

from agribot.autonomy.plan.coverage import swaths
from agribot.autonomy.plan.coverage.area import FieldArea, FieldPlan, Leg, MapLine, PlanRequest
from agribot.autonomy.plan.coverage.planner import plan_field
from agribot.autonomy.plan.ways.footprint import Footprint, measure_footprint
from agribot.core.errors import MissionError
from agribot.core.facts import NoPlaceToTurn, RowsTight, RowWithoutRoom, StartOutside
from agribot.description.loader import load_robot
from tests import nightly
from tests.autonomy.plan.fields import (
    REQUEST,
    ROW_REQUEST,
    ROWS,
    SHAPE,
    SQUARE,
    WITH_HOLE,
    certified,
    ten_hectares,
)
from tests.autonomy.plan.random_fields import random_field
from tests.finding import refused


def corners_outside_m(plan: FieldPlan, area: FieldArea, shape: Footprint) -> float:
    """Farthest that any corner of the robot gets out, from poses every few centimetres.

    Written apart from the certificate: poses, not sweeps; corner points, not boxes.
    """
    field = shapely.Polygon(area.boundary, area.holes)
    sides = (shape.half_width_m, -shape.half_width_m)
    corners = np.array([(x, y) for x in (shape.front_m, -shape.rear_m) for y in sides])
    spots = [np.zeros((0, 2))]
    course = None
    for leg in plan.legs:
        for start, end in zip(leg.xy_map_m[:-1], leg.xy_map_m[1:], strict=True):
            yaw = math.atan2(end[1] - start[1], end[0] - start[0])
            turn = 0.0 if course is None else math.remainder(yaw - course, math.tau)
            poses = [(start, yaw - turn * part) for part in np.linspace(1.0, 0.0, 8)]
            count = max(2, math.ceil(math.dist(start, end) / 0.5))
            poses += [(start + (end - start) * part, yaw) for part in np.linspace(0.0, 1.0, count)]
            for place, angle in poses:
                cos, sin = math.cos(angle), math.sin(angle)
                spots.append(place + corners @ np.array([[cos, sin], [-sin, cos]]))
            course = yaw
    points = shapely.points(np.concatenate(spots))
    return float(np.max(shapely.distance(field, points)))


def test_ten_hectares_with_two_holes_are_worked_and_certified() -> None:
    plan, certificate = certified(ten_hectares(), PlanRequest(implement_width_m=0.75))
    assert certificate.ok, certificate.problems
    assert certificate.coverage_ratio > 0.99
    assert certificate.field_ratio is not None and certificate.field_ratio > 0.99
    assert certificate.outside_m == 0.0
    assert certificate.clearance_m > 0.0
    assert certificate.working_length_m / certificate.length_m > 0.98
    assert certificate.field_area_m2 == pytest.approx(108152.8, abs=1.0)
    assert len(plan.legs) > 500


def test_forty_islands_of_trees_are_driven_around_wherever_they_stand_together() -> None:
    """Ways bent at a simplified outline, which a place between two trees did not see."""
    rng, angles = np.random.default_rng(3), np.linspace(0.0, math.tau, 7, endpoint=False)
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    trees = [
        shapely.Polygon(
            rng.uniform((4.0, 4.0), (96.0, 66.0)) + corners * rng.uniform(0.6, 1.2, (7, 1))
        )
        for _ in range(40)
    ]
    islands = shapely.get_parts(shapely.union_all(trees)).tolist()
    area = FieldArea(
        boundary=((0.0, 0.0), (100.0, 0.0), (100.0, 70.0), (0.0, 70.0)),
        holes=tuple(tuple(island.exterior.coords[:-1]) for island in islands),
    )
    plan, certificate = certified(area, msgspec.structs.replace(REQUEST, min_coverage_ratio=0.9))
    assert certificate.ok, certificate.problems
    assert certificate.clearance_m >= REQUEST.margin_m
    assert sum(leg.kind == "headland" for leg in plan.legs) > 30


@nightly.one_by_one("number", range(30), in_suite=4)
def test_a_random_field_is_worked_without_leaving_it_or_refused_with_a_reason(number: int) -> None:
    area, width_m = random_field(np.random.default_rng([7, number]))
    request = PlanRequest(implement_width_m=width_m)
    shape = measure_footprint(load_robot("agribot"), width_m)
    try:
        plan, certificate = certified(area, request, shape)
    except MissionError as error:
        assert "no place to turn" in str(error)
        return
    assert certificate.ok, certificate.problems
    assert certificate.coverage_ratio >= 0.99
    assert corners_outside_m(plan, area, shape) == 0.0


def test_the_search_takes_the_direction_with_the_fewest_swaths() -> None:
    long_field = FieldArea(boundary=((0.0, 0.0), (40.0, 20.0), (36.0, 28.0), (-4.0, 8.0)))
    found, _ = certified(long_field)
    assert math.tan(found.swath_yaw_rad) == pytest.approx(0.5, abs=1e-6)
    across = msgspec.structs.replace(REQUEST, swath_yaw_rad=found.swath_yaw_rad + math.pi / 2)
    other, certificate = certified(long_field, across)
    assert certificate.ok
    assert len(other.legs) > 2 * len(found.legs)


def test_swaths_follow_the_ab_line_and_one_lies_on_it() -> None:
    area = msgspec.structs.replace(SQUARE, ab_line=((3.0, 4.0), (9.0, 7.0)))
    plan, certificate = certified(area)
    assert certificate.ok, certificate.problems
    swaths = [leg.xy_map_m for leg in plan.legs if leg.kind == "swath"]
    across = np.array([-math.sin(plan.swath_yaw_rad), math.cos(plan.swath_yaw_rad)])
    offsets = np.array([(swath @ across - np.array((3.0, 4.0)) @ across) for swath in swaths])
    assert np.ptp(offsets, axis=1).max() < 1e-6
    assert np.abs(offsets).min() < 1e-6
    pitch = offsets[:, 0] / REQUEST.spacing_m
    assert np.abs(pitch - np.round(pitch)).max() < 1e-6


def test_obstacles_are_driven_around_and_their_edges_worked() -> None:
    plan, certificate = certified(WITH_HOLE)
    assert certificate.ok, certificate.problems
    assert corners_outside_m(plan, WITH_HOLE, SHAPE) == 0.0
    hole = shapely.Polygon(WITH_HOLE.holes[0])
    near = [leg for leg in plan.legs if leg.kind == "headland"
            and shapely.LineString(leg.xy_map_m).distance(hole) < 0.7]  # fmt: skip
    assert near


def test_more_headland_passes_make_room_for_turns_in_arcs() -> None:
    wide = msgspec.structs.replace(REQUEST, headland_passes=3)
    plan, certificate = certified(SQUARE, wide)
    assert certificate.ok, certificate.problems
    arcs = [leg for leg in plan.legs if leg.kind == "arc"]
    assert len(arcs) > 10
    assert certificate.max_curvature_radpm <= 1.05 / 0.3
    pivots, certificate = certified(SQUARE, msgspec.structs.replace(wide, turns="pivot"))
    assert certificate.ok
    assert not [leg for leg in pivots.legs if leg.kind == "arc"]


def test_crop_rows_are_straddled_each_once_and_no_wheel_comes_near_them() -> None:
    plan, certificate = certified(ROWS, ROW_REQUEST)
    assert certificate.ok, certificate.problems
    rows = [leg for leg in plan.legs if leg.kind == "row"]
    assert sorted(leg.row for leg in rows) == list(range(6))
    assert certificate.wheel_row_clearance_m == pytest.approx(0.39 - 0.025, abs=1e-3)
    for leg in rows:
        line = shapely.LineString(ROWS.rows[leg.row])
        assert shapely.LineString(leg.xy_map_m).buffer(1e-6).covers(line)


def nearest_turn_m(plan: FieldPlan, rows: tuple[MapLine, ...]) -> float:
    """How near to any row the robot leaves one and turns."""
    crop = shapely.MultiLineString(rows)
    ends = [leg.xy_map_m[end] for leg in plan.legs if leg.kind == "row" for end in (0, -1)]
    return min(crop.distance(shapely.Point(end)) for end in ends)


@pytest.mark.parametrize(("margin_m", "clear_m"), [(0.05, 0.1), (0.3, 0.3), (1.5, 0.5)])
def test_a_robot_unsure_of_its_place_turns_farther_from_the_crop_of_every_row(
    margin_m: float, clear_m: float
) -> None:
    """Also where the rows do not end side by side."""
    rows = tuple(((float(x), 0.4 * (x % 2)), (float(x), 10.0 + 0.3 * (x % 3))) for x in range(6))
    request = msgspec.structs.replace(ROW_REQUEST, margin_m=margin_m)
    plan, certificate = certified(msgspec.structs.replace(ROWS, rows=rows), request)
    assert certificate.ok, certificate.problems
    assert sum(leg.kind == "row" for leg in plan.legs) == 6
    assert SHAPE.wheel_turn_radius_m + clear_m < nearest_turn_m(plan, rows)
    assert nearest_turn_m(plan, rows) < SHAPE.wheel_turn_radius_m + clear_m + 0.2


def test_a_plan_begins_where_the_robot_stands() -> None:
    request = msgspec.structs.replace(REQUEST, start_map_m=(18.0, 12.0))
    plan, certificate = certified(WITH_HOLE, request)
    assert certificate.ok
    assert plan.legs[0].xy_map_m[0].tolist() == [18.0, 12.0]
    with refused(StartOutside(10.0, 7.0, ANY, ANY)):
        certified(WITH_HOLE, msgspec.structs.replace(REQUEST, start_map_m=(10.0, 7.0)))


def test_ground_behind_a_narrow_passage_is_named_and_left_out() -> None:
    left = ((10.0, 4.9), (10.0, 9.0), (0.0, 9.0), (0.0, 0.0), (10.0, 0.0), (10.0, 4.0))
    right = ((14.0, 4.0), (14.0, 0.0), (20.0, 0.0), (20.0, 9.0), (14.0, 9.0), (14.0, 4.9))
    boundary = (*left, *right)
    plan, certificate = certified(FieldArea(boundary=boundary))
    assert certificate.ok, certificate.problems
    assert len(plan.warnings) == 1
    assert "cannot be reached" in plan.warnings[0]
    assert certificate.field_ratio is not None and certificate.field_ratio < 0.7


def test_a_field_smaller_than_the_robot_is_refused_with_both_sizes() -> None:
    tiny = FieldArea(boundary=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
    with refused(NoPlaceToTurn(1.19, ANY, ANY)):
        plan_field(tiny, SHAPE, REQUEST)


def test_a_row_without_room_behind_its_end_is_refused_with_the_place() -> None:
    rows = (*ROWS.rows, ((6.0, 0.0), (6.0, 15.5)))
    with refused(RowWithoutRoom(7, ANY, 6.0, ANY)):
        plan_field(msgspec.structs.replace(ROWS, rows=rows), SHAPE, ROW_REQUEST)


def test_the_same_field_gives_the_same_plan() -> None:
    def points(legs: tuple[Leg, ...]) -> list[bytes]:
        return [leg.xy_map_m.tobytes() for leg in legs]

    assert points(certified(WITH_HOLE)[0].legs) == points(certified(WITH_HOLE)[0].legs)


def test_the_direction_of_the_swaths_does_not_depend_on_how_many_are_tried_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pond = shapely.Point(0.0, 0.0).buffer(9.0, quad_segs=6)
    work = shapely.MultiPolygon([pond, shapely.Polygon([(20, 0), (50, 7), (48, 16), (18, 9)])])
    at_once = swaths.search_yaw_rad(work, 0.7)
    monkeypatch.setattr(swaths, "MAX_PRODUCTS", 100)
    assert swaths.search_yaw_rad(work, 0.7) == at_once


@pytest.mark.parametrize("margin_m", [0.0, 0.05, 0.5, 2.0])
def test_a_plan_keeps_the_margin_that_it_is_asked_for_around_every_corner(margin_m: float) -> None:
    """Chords around corners and rounded bends took up to 13 cm of it."""
    notch = FieldArea(
        boundary=((0.0, 0.0), (30.0, 0.0), (30.0, 24.0), (16.0, 23.0), (15.0, 17.0), (0.0, 20.0)),
        holes=(((9.0, 8.0), (9.6, 8.0), (9.6, 8.6), (9.0, 8.6)),),
    )
    request = msgspec.structs.replace(REQUEST, margin_m=margin_m, min_coverage_ratio=0.98)
    plan, certificate = certified(notch, request)
    assert certificate.ok, certificate.problems
    assert margin_m <= certificate.clearance_m < margin_m + 0.002
    field = shapely.Polygon(notch.boundary, notch.holes)
    ways = shapely.MultiLineString([leg.xy_map_m for leg in plan.legs])
    assert ways.distance(field.boundary) >= SHAPE.turn_radius_m + margin_m


@pytest.mark.parametrize("pitch_m", [0.3, 0.45, 0.5])
def test_rows_narrower_than_the_track_are_refused_with_the_machine_and_the_numbers(
    pitch_m: float,
) -> None:
    """Sugar beet stands at 45 cm. The check spoke of a wheel and of the row, not of the robot."""
    rows = tuple(((x * pitch_m, 0.0), (x * pitch_m, 10.0)) for x in range(3))
    beet = msgspec.structs.replace(ROWS, rows=rows)
    shape = measure_footprint(load_robot("agribot"), 0.4)
    with refused(RowsTight(1, 2, "agribot", pitch_m, 0.78, ANY, ANY, 0.1, 0.52)):
        plan_field(beet, shape, ROW_REQUEST)
    wide = tuple(((0.52 * x, 0.0), (0.52 * x, 10.0)) for x in range(3))
    assert certified(msgspec.structs.replace(ROWS, rows=wide), ROW_REQUEST, shape)[1].ok
