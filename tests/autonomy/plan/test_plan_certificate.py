"""Plans with a fault in them: the check finds each, and says where."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.autonomy.plan.coverage.area import FieldPlan, Leg, LegKind
from agribot.autonomy.plan.coverage.plan_certificate import Certificate, certify_plan
from agribot.core.facts import LegsApart, LegTight, NearEdge
from tests.autonomy.plan.fields import (
    REQUEST,
    ROW_REQUEST,
    ROWS,
    SHAPE,
    SQUARE,
    WITH_HOLE,
    certified,
)
from tests.finding import find

ANY = msgspec.structs.replace(REQUEST, min_coverage_ratio=0.0)


def leg(kind: LegKind, *points: tuple[float, float]) -> Leg:
    return Leg(kind=kind, xy_map_m=np.array(points))


def check(*legs: Leg, area: object = SQUARE) -> Certificate:
    return certify_plan(FieldPlan(legs=legs, swath_yaw_rad=0.0), area, SHAPE, ANY)  # type: ignore[arg-type]


def rules(certificate: Certificate) -> set[str]:
    return {problem.rule for problem in certificate.problems}


def test_a_straight_drive_close_along_the_edge_is_fine_though_turning_there_is_not() -> None:
    beside = leg("swath", (2.0, 0.48), (18.0, 0.48))
    good = check(beside)
    assert good.ok, good.problems
    assert good.clearance_m == pytest.approx(0.48 - SHAPE.half_width_m, abs=1e-6)
    turned = check(beside, leg("link", (18.0, 0.48), (18.0, 5.0)))
    assert rules(turned) == {"footprint"}
    assert turned.problems[0].east_m == pytest.approx(18.0, abs=1.0)
    assert turned.problems[0].north_m < 0.0


def test_a_plan_that_comes_nearer_to_an_edge_than_was_asked_for_is_refused_at_that_place() -> None:
    """Plans were certified with 13 mm where 50 were asked for."""
    near = check(leg("swath", (2.0, 0.45), (18.0, 0.45)), leg("link", (18.0, 0.45), (19.0, 0.45)))
    assert rules(near) == {"margin"}
    assert near.problems[0].north_m == pytest.approx(0.0, abs=1e-6)
    assert find(near.problems[0].fact, NearEdge).clearance_m == pytest.approx(0.03, abs=5e-5)
    touching = check(leg("swath", (2.0, 0.42), (18.0, 0.42)))
    assert rules(touching) == {"margin"}


def test_a_way_through_a_hole_is_refused_at_the_hole() -> None:
    through = check(leg("link", (2.0, 7.0), (18.0, 7.0)), area=WITH_HOLE)
    assert rules(through) == {"footprint"}
    assert 3.5 < through.outside_m < 4.5
    assert 7.0 < through.problems[0].east_m < 12.5
    past = check(leg("link", (2.0, 11.0), (18.0, 11.0)), area=WITH_HOLE)
    assert past.ok


def test_a_corner_of_the_robot_that_clips_a_hole_counts() -> None:
    clipping = check(leg("link", (2.0, 9.35), (18.0, 9.35)), area=WITH_HOLE)
    assert rules(clipping) == {"footprint"}
    assert clipping.outside_m == 0.0  # the centre stays in the field, the side does not


def test_a_corner_with_the_tool_on_is_refused_and_one_without_is_a_turn_in_place() -> None:
    corner = ((2.0, 2.0), (8.0, 2.0), (8.0, 8.0))
    assert rules(check(leg("swath", *corner))) == {"curvature"}
    assert find(check(leg("swath", *corner)).problems[0].fact, LegTight).is_working
    off = check(leg("link", *corner))
    assert off.ok
    assert off.pivots == 1


def test_an_arc_tighter_than_the_drive_can_is_refused() -> None:
    def arc(radius_m: float) -> Leg:
        angles = np.linspace(0.0, math.pi, 40)
        return leg(
            "arc", *((8 + radius_m * math.sin(a), 8 - radius_m * math.cos(a)) for a in angles)
        )

    assert check(arc(0.31)).ok
    assert rules(check(arc(0.2))) == {"curvature"}


def test_a_jump_between_legs_is_refused() -> None:
    jump = check(leg("swath", (2.0, 2.0), (8.0, 2.0)), leg("swath", (8.0, 2.5), (2.0, 2.5)))
    assert rules(jump) == {"path"}
    assert find(jump.problems[0].fact, LegsApart).gap_m == pytest.approx(0.5)


def test_a_place_that_is_no_number_is_refused() -> None:
    assert rules(check(leg("swath", (2.0, 2.0), (math.nan, 2.0)))) == {"path"}
    assert rules(check()) == {"path"}


def test_a_swath_left_out_is_missed_where_it_was() -> None:
    plan, certificate = certified(SQUARE)
    assert certificate.ok
    kept = list(plan.legs)
    gap = next(k for k, part in enumerate(kept) if part.kind == "swath" and part.length_m > 10.0)
    place = kept[gap].xy_map_m.mean(axis=0)
    kept[gap] = msgspec.structs.replace(kept[gap], kind="link", row=-1)
    broken = msgspec.structs.replace(plan, legs=tuple(kept))
    refused = certify_plan(broken, SQUARE, SHAPE, REQUEST)
    assert rules(refused) == {"coverage"}
    lost_m2 = certificate.covered_area_m2 - refused.covered_area_m2
    assert lost_m2 == pytest.approx(kept[gap].length_m * 0.7, rel=0.1)
    assert abs(refused.problems[0].north_m - place[1]) < 1.0


def test_overlap_counts_ground_that_is_worked_twice() -> None:
    once = leg("swath", (2.0, 5.0), (12.0, 5.0))
    again = leg("swath", (12.0, 5.0), (2.0, 5.0))
    assert check(once).overlap_ratio == pytest.approx(0.0, abs=1e-9)
    assert check(once, again).overlap_ratio == pytest.approx(1.0, abs=1e-6)


def test_a_wheel_on_a_crop_row_is_refused_at_the_row() -> None:
    plan, _ = certified(ROWS, ROW_REQUEST)
    moved = tuple(
        msgspec.structs.replace(part, xy_map_m=part.xy_map_m + np.array([0.39, 0.0]))
        for part in plan.legs
    )
    shifted = msgspec.structs.replace(plan, legs=moved)
    refused = certify_plan(shifted, ROWS, SHAPE, ROW_REQUEST)
    assert "wheels" in rules(refused)
    assert refused.wheel_row_clearance_m == pytest.approx(-SHAPE.wheel_half_width_m, abs=1e-3)
    problem = next(p for p in refused.problems if p.rule == "wheels")
    assert abs(problem.east_m - round(problem.east_m)) < 0.05


def test_turning_in_place_over_a_row_is_refused() -> None:
    turn = (leg("link", (2.0, -2.0), (2.0, 3.0)), leg("link", (2.0, 3.0), (2.0, -2.0)))
    refused = certify_plan(
        FieldPlan(legs=turn, swath_yaw_rad=0.0), ROWS, SHAPE,
        msgspec.structs.replace(ROW_REQUEST, min_coverage_ratio=0.0),
    )  # fmt: skip
    assert rules(refused) == {"wheels"}
