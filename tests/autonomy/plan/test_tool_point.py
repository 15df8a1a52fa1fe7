"""The tool sits behind the robot's middle: what it passes is what counts as worked."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
import shapely

from agribot.autonomy.plan.coverage.area import FieldPlan, Leg, PlanRequest
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
from agribot.autonomy.plan.coverage.plan_sweep import trace_tool
from agribot.autonomy.plan.mission.route import Route, Tool
from agribot.autonomy.plan.ways.boustrophedon import plan_rows
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import FieldConfig
from agribot.core.errors import MissionError
from agribot.core.facts import NoPlaceToTurn, NoWayInside
from agribot.core.messages import FloatArray
from agribot.description.loader import load_robot
from tests.autonomy.plan.fields import REQUEST, SHAPE, SQUARE, WITH_HOLE, certified
from tests.autonomy.plan.planting import FARM_START, MISSION
from tests.autonomy.plan.random_fields import random_field
from tests.robot_parts import plain_rover

BEHIND_M = -0.35
BEHIND = msgspec.structs.replace(REQUEST, tool_x_m=BEHIND_M)


def tool_lines(work: FieldWork) -> list[FloatArray]:
    """Where the tool is while it works, from the driven path and its headings alone."""
    path = work.plan_from((5.0, 5.0, 0.0))
    ahead = np.column_stack([np.cos(path.yaw_map_rad), np.sin(path.yaw_map_rad)])
    tool = path.xy_map_m + work.request.tool_x_m * ahead
    runs = np.split(np.arange(len(tool)), np.flatnonzero(np.diff(path.row)) + 1)
    return [tool[run] for run in runs if path.row[run[0]] >= 0 and len(run) > 1]


def test_the_ground_behind_the_last_place_of_the_tool_is_not_worked() -> None:
    line = Leg(kind="swath", xy_map_m=np.array([(4.0, 7.0), (14.0, 7.0)]))
    plan = FieldPlan(legs=(line,), swath_yaw_rad=0.0)
    field = shapely.Polygon(SQUARE.boundary)
    for tool_x_m in (BEHIND_M, 0.0, 0.5):
        request = msgspec.structs.replace(REQUEST, tool_x_m=tool_x_m)
        missed = certify_plan(plan, SQUARE, SHAPE, request).problems[0]
        assert missed.rule == "coverage"
        worked = shapely.box(4.0 + tool_x_m, 6.6, 14.0 + tool_x_m, 7.4).intersection(field)
        covered_m2 = certify_plan(plan, SQUARE, SHAPE, request).covered_area_m2
        assert covered_m2 == pytest.approx(worked.area)
        assert not worked.contains(shapely.Point(missed.east_m, missed.north_m))


def test_a_tool_behind_a_robot_that_drives_an_arc_moves_along_a_wider_arc() -> None:
    """It was traced as a saw with teeth of 4 cm, whose ground took half a second a field."""
    bend_rad = np.arange(0.0, math.pi, 0.1)
    arc = 0.5 * np.column_stack([np.sin(bend_rad), -np.cos(bend_rad)])
    trace = trace_tool(arc, BEHIND_M)
    assert np.hypot(*trace[1:-1].T) == pytest.approx(math.hypot(0.5, BEHIND_M), abs=1e-3)
    assert len(trace) == len(arc)


def test_a_tool_swings_where_the_robot_turns_in_place() -> None:
    corner = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0)])
    trace = trace_tool(corner, -0.5)
    assert trace == pytest.approx(np.array([(-0.5, 0.0), (1.5, 0.0), (2.0, -0.5), (2.0, 1.5)]))


@pytest.mark.parametrize("area", [SQUARE, WITH_HOLE], ids=["plain", "with a hole"])
def test_the_way_of_the_tool_along_the_driven_path_is_the_worked_ground(area: object) -> None:
    plan, certificate = certified(area, BEHIND)  # type: ignore[arg-type]
    assert certificate.ok, certificate.problems
    work = FieldWork(plan, area, SHAPE, BEHIND)  # type: ignore[arg-type]
    bands = [
        shapely.LineString(line).buffer(BEHIND.implement_width_m / 2.0, cap_style="flat")
        for line in tool_lines(work)
    ]
    passed = shapely.union_all(bands).intersection(
        shapely.Polygon(area.boundary, area.holes)  # type: ignore[attr-defined]
    )
    assert passed.area == pytest.approx(certificate.covered_area_m2, rel=2e-3)


def test_swaths_are_driven_until_the_tool_has_worked_them_and_from_where_it_begins() -> None:
    middle, _ = certified(SQUARE)
    behind, _ = certified(SQUARE, BEHIND)
    for one, other in zip(
        [leg for leg in middle.legs if leg.kind == "swath"],
        [leg for leg in behind.legs if leg.kind == "swath"],
        strict=True,
    ):
        along = one.xy_map_m[-1] - one.xy_map_m[0]
        shift = -BEHIND_M * along / np.hypot(*along)
        np.testing.assert_allclose(other.xy_map_m, one.xy_map_m + shift, atol=1e-6)


def test_a_narrow_implement_gets_headland_enough_for_its_tool() -> None:
    narrow = PlanRequest(implement_width_m=0.5, tool_x_m=BEHIND_M)
    assert narrow.passes(has_rows=False) == 2
    assert narrow.passes(has_rows=True) == 0
    assert BEHIND.passes(has_rows=False) == 1
    _, certificate = certified(SQUARE, narrow)
    assert certificate.ok, certificate.problems
    single = msgspec.structs.replace(narrow, headland_passes=1)
    _, poorer = certified(SQUARE, single)
    assert 1.0 - poorer.coverage_ratio > 5.0 * (1.0 - certificate.coverage_ratio)


@pytest.mark.parametrize("number", range(12))
def test_random_fields_are_worked_by_a_tool_behind_the_robot(number: int) -> None:
    robot = load_robot("agribot")
    area, width_m = random_field(np.random.default_rng([11, number]))
    request = PlanRequest(implement_width_m=width_m, tool_x_m=robot.tool_x_m)
    assert robot.tool_x_m == BEHIND_M
    try:
        _, certificate = certified(area, request, measure_footprint(robot, width_m))
    except MissionError as error:
        assert isinstance(error.fact, NoPlaceToTurn | NoWayInside)
        return
    assert certificate.ok, certificate.problems


def test_the_tool_works_where_it_is_itself_beside_a_row_and_never_in_a_turn() -> None:
    rows = lay_rows(FieldConfig(row_count=3, row_length_m=4.0))
    path = plan_rows(rows, FARM_START, plain_rover(), MISSION)
    reach_m = 0.3
    route = Route(path, [0, 1, 2], MISSION, (), Tool(x_m=BEHIND_M, reach_m=reach_m))
    for index in range(len(path.s_m)):
        route.progress.index = index
        inside = path.s_m[path.row == max(route.tool_row, 0)]
        tool_m = path.s_m[index] + BEHIND_M
        if route.tool_row >= 0:
            assert inside[0] - reach_m - 1e-9 <= tool_m <= inside[-1] + reach_m + 1e-9
            assert path.curvature_radpm[index] == 0.0
    on = np.array([_row_of(route, index) for index in range(len(path.s_m))])
    for row in range(3):
        inside, worked = path.s_m[path.row == row], path.s_m[on == row] + BEHIND_M
        assert worked[0] == pytest.approx(inside[0] - reach_m, abs=0.021)
        assert worked[-1] == pytest.approx(inside[-1] + reach_m, abs=0.021)


def _row_of(route: Route, index: int) -> int:
    route.progress.index = index
    return route.tool_row


def test_the_circle_of_a_turn_holds_the_implement_too() -> None:
    robot = load_robot("agribot")
    assert measure_footprint(robot, 3.0).turn_radius_m >= math.hypot(BEHIND_M, 1.5)
    assert measure_footprint(robot, 3.0, tool_x_m=0.8).front_m == 0.8
