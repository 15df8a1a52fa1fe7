"""From one swath into the next: in place, in arcs, or with three points; certified and driven."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
import shapely

from agribot.autonomy.plan.coverage.area import FieldPlan, Leg, LegKind, TurnStyle
from agribot.autonomy.plan.coverage.drive import FieldWork, sample_legs
from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
from agribot.autonomy.plan.coverage.turns import plan_three_point_turn
from agribot.autonomy.plan.ways.speed import CREEP_MPS, find_pivots, plan_speed_mps
from agribot.core.messages import FloatArray
from agribot.core.pose import Pose2
from tests.autonomy.plan.fields import REQUEST, ROWS, SHAPE, SQUARE, certified
from tests.autonomy.plan.planting import MISSION

OPEN = shapely.box(-5.0, -5.0, 5.0, 5.0)
ROOMY = msgspec.structs.replace(REQUEST, headland_passes=3, tool_x_m=-0.35)
ANY = msgspec.structs.replace(REQUEST, min_coverage_ratio=0.0)


def leg(kind: LegKind, *points: tuple[float, float]) -> Leg:
    return Leg(kind=kind, xy_map_m=np.array(points))


def course_rad(xy: FloatArray, first: int) -> float:
    dx, dy = xy[first + 1] - xy[first]
    return math.atan2(dy, dx)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("ahead_m", [0.7, 0.0, -0.7])
def test_three_points_lead_from_pose_to_pose_and_back_up_once(side: float, ahead_m: float) -> None:
    start, end = Pose2(0.0, 0.0, 0.0), Pose2(ahead_m, side * 0.6, math.pi)
    way = plan_three_point_turn(start, end, OPEN)
    assert way is not None
    into, back, out = way
    for one, other in ((into, back), (back, out)):
        np.testing.assert_allclose(one[-1], other[0], atol=1e-9)
    np.testing.assert_allclose(into[0], start.xy_m)
    np.testing.assert_allclose(out[-1], end.xy_m)
    assert math.dist(*back) == pytest.approx(1.0 - 0.6)
    turned_back = course_rad(back, 0) - course_rad(into, -2)
    assert abs(math.remainder(turned_back, math.tau)) == pytest.approx(math.pi, abs=0.06)
    assert into[:, 0].max() <= max(ahead_m, 0.0) + 0.5 + 1e-9


def test_three_points_are_refused_where_they_do_not_fit_or_are_not_needed() -> None:
    start = Pose2(0.0, 0.0, 0.0)
    assert (
        plan_three_point_turn(start, Pose2(0.0, 0.6, math.pi), shapely.box(-1, -1, 0.4, 1)) is None
    )
    assert plan_three_point_turn(start, Pose2(0.0, 1.1, math.pi), OPEN) is None
    assert plan_three_point_turn(start, Pose2(0.0, 0.6, 2.0), OPEN) is None


@pytest.mark.parametrize("style", ["pivot", "arc", "three-point"])
def test_every_style_of_turn_is_certified(style: TurnStyle) -> None:
    plan, certificate = certified(SQUARE, msgspec.structs.replace(ROOMY, turns=style))
    assert certificate.ok, certificate.problems
    kinds = [leg.kind for leg in plan.legs]
    swaths = kinds.count("swath")
    assert (kinds.count("reverse") > 0.7 * swaths) == (style == "three-point")
    assert (kinds.count("arc") > 0.7 * swaths) == (style != "pivot")
    if style != "pivot":
        pivot, _ = certified(SQUARE, msgspec.structs.replace(ROOMY, turns="pivot"))
        assert certificate.pivots < 0.4 * certify_plan(pivot, SQUARE, SHAPE, ROOMY).pivots


def test_backing_out_of_the_field_is_refused_where_the_rear_leaves_it() -> None:
    into = leg("arc", (4.0, 5.0), (2.0, 5.0))
    fine = (into, leg("reverse", (2.0, 5.0), (4.0, 5.0)))
    assert certify_plan(FieldPlan(legs=fine, swath_yaw_rad=0.0), SQUARE, SHAPE, ANY).pivots == 0
    over = (leg("arc", (2.0, 5.0), (4.0, 5.0)), leg("reverse", (4.0, 5.0), (0.2, 5.0)))
    refused = certify_plan(FieldPlan(legs=over, swath_yaw_rad=0.0), SQUARE, SHAPE, ANY)
    assert [problem.rule for problem in refused.problems if problem.rule != "coverage"] == [
        "footprint"
    ]
    assert refused.problems[0].east_m < 0.0
    nose = (leg("reverse", (4.0, 5.0), (0.36, 5.0)),)  # the rear reaches 0.34 m, the nose is inside
    alone = certify_plan(FieldPlan(legs=nose, swath_yaw_rad=0.0), SQUARE, SHAPE, ANY)
    assert alone.clearance_m == pytest.approx(0.36 - SHAPE.rear_m, abs=1e-6)


def test_a_turn_in_place_before_backing_over_a_crop_row_is_refused() -> None:
    legs = (leg("link", (0.5, -1.0), (0.5, -0.45)), leg("reverse", (0.5, -0.45), (0.5, 2.0)))
    refused = certify_plan(FieldPlan(legs=legs, swath_yaw_rad=0.0), ROWS, SHAPE, ANY)
    assert "wheels" in {problem.rule for problem in refused.problems}


def test_backwards_the_robot_looks_against_its_way_and_stops_before_and_after() -> None:
    legs = [leg("arc", (0.0, 0.0), (1.0, 0.0)), leg("reverse", (1.0, 0.0), (0.4, 0.0)),
            leg("arc", (0.4, 0.0), (2.0, 0.0))]  # fmt: skip
    path = sample_legs(legs, [None] * 3)
    np.testing.assert_allclose(np.abs(np.exp(1j * path.yaw_map_rad) - 1.0), 0.0, atol=1e-9)
    assert path.s_m[-1] == pytest.approx(1.0 + 0.6 + 1.6)
    cusps = find_pivots(path)
    assert [float(path.s_m[k]) for k in cusps] == pytest.approx([1.0, 1.6])
    speed = plan_speed_mps(path, MISSION)
    assert [speed[k] for k in cusps] == [CREEP_MPS] * 2
    assert max(speed[cusps[0] : cusps[1]]) <= MISSION.turn_speed_mps


def test_a_plan_with_three_point_turns_is_one_path_without_jumps() -> None:
    request = msgspec.structs.replace(ROOMY, turns="three-point")
    plan, _ = certified(SQUARE, request)
    path = FieldWork(plan, SQUARE, SHAPE, request).plan_from((5.0, 5.0, 0.0))
    steps_m = np.hypot(*np.diff(path.xy_map_m, axis=0).T)
    np.testing.assert_allclose(steps_m, np.diff(path.s_m), atol=2e-3)
