"""Whatever people draw: a plan keeps the margin to all of it, or is refused with a reason."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import numpy.typing as npt
import pytest
import shapely

from agribot.autonomy.plan.coverage.area import FieldPlan, PlanRequest, TurnStyle
from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
from agribot.autonomy.plan.coverage.planner import plan_field
from agribot.autonomy.plan.ways.footprint import Footprint, measure_footprint
from agribot.core.errors import MissionError
from agribot.core.facts import (
    GroundMissed,
    NoPlaceToTurn,
    NothingReachable,
    NoWayInside,
    OverlapWide,
)
from agribot.core.messages import FloatArray
from agribot.description.loader import load_robot
from agribot.gis.field_file import read_field
from tests import nightly
from tests.gis.drawn_at_random import HERE, DrawnField, draw_field

ROBOT = load_robot("agribot")
EXACT_M = 1e-3
STEP_M, TURN_RAD = 0.3, math.radians(6.0)
# What a planner may refuse such fields for, and the problems of a plan.
REFUSALS = (NoPlaceToTurn, NoWayInside, OverlapWide)
PROBLEMS = (GroundMissed, NothingReachable)


def list_poses(plan: FieldPlan) -> FloatArray:
    """Where the robot is and looks along a plan, (N, 3); written apart from the certificate."""
    poses: list[tuple[float, float, float]] = []
    for leg in plan.legs:
        for start, end in zip(leg.xy_map_m[:-1], leg.xy_map_m[1:], strict=True):
            yaw = math.atan2(*(end - start)[::-1]) + leg.is_reverse * math.pi
            if poses:
                turn = math.remainder(yaw - poses[-1][2], math.tau)
                steps = np.linspace(1.0, 0.0, max(2, math.ceil(abs(turn) / TURN_RAD)))
                poses += [(start[0], start[1], yaw - turn * step) for step in steps]
            count = max(2, math.ceil(math.dist(start, end) / STEP_M))
            poses += [(*(start + (end - start) * r), yaw) for r in np.linspace(0.0, 1.0, count)]
    return np.array(poses)


def draw_robots(poses: FloatArray, shape: Footprint) -> npt.NDArray[np.object_]:
    corners = np.array(
        [(x_m, y_m)
         for x_m, side in ((shape.front_m, 1), (-shape.rear_m, -1))
         for y_m in (side * shape.half_width_m, -side * shape.half_width_m)]
    )  # fmt: skip
    cos, sin = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x_m = poses[:, :1] + cos * corners[:, 0] - sin * corners[:, 1]
    y_m = poses[:, 1:2] + sin * corners[:, 0] + cos * corners[:, 1]
    return np.asarray(shapely.polygons(np.stack([x_m, y_m], axis=2)))


def measure_margin_m(plan: FieldPlan, drawn: DrawnField, shape: Footprint) -> float:
    """Least distance of the robot from any edge; negative where it is not on the ground at all."""
    robots = draw_robots(list_poses(plan), shape)
    shapely.prepare(drawn.ground)
    if not np.all(shapely.covers(drawn.ground, robots)):
        return -1.0
    edge = drawn.ground.boundary
    shapely.prepare(edge)
    return float(np.min(shapely.distance(edge, robots)))


@nightly.all_or_first("seeds", range(150), in_suite=8, unit="fields")
def test_every_plan_of_a_drawn_field_keeps_its_margin_or_is_refused_with_a_reason(
    seeds: Sequence[int], tmp_path: Path
) -> None:
    planned = 0
    for seed in seeds:
        rng = np.random.default_rng([11, seed])
        drawn = draw_field(rng)
        path = tmp_path / f"{seed}.geojson"
        path.write_text(drawn.text)
        width_m = float(rng.choice([0.6, 0.9, 1.5]))
        shape = measure_footprint(ROBOT, width_m)
        request = PlanRequest(
            implement_width_m=width_m, tool_x_m=ROBOT.tool_x_m,
            margin_m=float(rng.choice([0.0, 0.05, 0.3, 1.0])),
            turns=str(rng.choice(get_args(TurnStyle))),  # type: ignore[arg-type]
        )  # fmt: skip
        try:
            area, _ = read_field(path, HERE)
            plan = plan_field(area, shape, request)
        except MissionError as error:
            assert isinstance(error.fact, REFUSALS), (seed, error.fact)
            continue
        certificate = certify_plan(plan, area, shape, request)
        margin_m = measure_margin_m(plan, drawn, shape)
        assert margin_m >= request.margin_m - EXACT_M, seed
        if not certificate.ok:
            assert isinstance(certificate.problems[0].fact, PROBLEMS), (seed, certificate)
            continue
        planned += 1
        assert certificate.clearance_m <= margin_m + EXACT_M, seed
    assert planned > 0.5 * len(seeds)


@pytest.mark.parametrize("shift_m", [0.02, 0.2])
def test_a_plan_that_is_shifted_towards_an_edge_is_refused_and_found_by_the_other_check(
    shift_m: float, tmp_path: Path
) -> None:
    """The two checks fail where they should."""
    drawn = draw_field(np.random.default_rng([11, 1]))
    path = tmp_path / "field.geojson"
    path.write_text(drawn.text)
    shape = measure_footprint(ROBOT, 0.9)
    request = PlanRequest(implement_width_m=0.9, tool_x_m=ROBOT.tool_x_m)
    area, _ = read_field(path, HERE)
    plan = plan_field(area, shape, request)
    assert certify_plan(plan, area, shape, request).ok
    legs = tuple(
        msgspec.structs.replace(leg, xy_map_m=leg.xy_map_m + np.array((shift_m, 0.0)))
        for leg in plan.legs
    )
    moved = FieldPlan(legs=legs, swath_yaw_rad=plan.swath_yaw_rad)
    rules = {problem.rule for problem in certify_plan(moved, area, shape, request).problems}
    assert rules & {"margin", "footprint"}
    assert measure_margin_m(moved, drawn, shape) < request.margin_m - EXACT_M
