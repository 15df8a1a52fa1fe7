"""Somebody steps into the robot's way: where, when, and what becomes of it by the truth."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.encounter import Encounter
from agribot.core.robot import Origin, RobotSpec, Shape
from agribot.core.world import Waypoint, WorldSpec
from agribot.description.lidar import fit_lidar
from agribot.description.sdf_actors import FIGURES, load_figure
from agribot.sim.platform import SimPlatform
from agribot.sim.truth import Truth
from agribot.sim.visit_log import VisitLog
from agribot.sim.visitors import (
    AHEAD_M,
    ASIDE_M,
    PARKED_M,
    SPEEDS_MPS,
    Plan,
    Visitor,
    add_visitors,
    draw_plans,
)
from agribot.sim.walkers import measure_robot_outline

POST = Shape(kind="cylinder", size_m=(0.2, 1.8, 0.0), origin=Origin(xyz_m=(0.0, 0.0, 0.9)))
FAR = Waypoint(t_s=0.0, x_map_m=PARKED_M, y_map_m=0.0, yaw_rad=0.0)
PLAN = Plan(figure="dog", begin_s=5.0, side=1, ahead_m=1.0, speed_mps=1.0, stays_s=4.0)
AT_CROSSING_S = PLAN.begin_s + ASIDE_M / PLAN.speed_mps
TICK_S = 0.02


def meet(robot: RobotSpec, speeds_mps: dict[float, float]) -> tuple[Encounter, Visitor]:
    """Let a robot drive North at these speeds, each from its time on, while a post comes."""
    visitor = Visitor(name="post", kind="dog", shapes=(POST,), waypoints=(FAR,), plan=PLAN, way=[])
    log, y_m = VisitLog(robot, [visitor]), 0.0
    assert visitor.find_place(2.0) == (PARKED_M, 0.0, 0.0)
    for tick in range(1, 1000):
        t_s = tick * TICK_S
        v_mps = next(v for since_s, v in reversed(speeds_mps.items()) if t_s >= since_s)
        y_m += v_mps * TICK_S
        log.update(Truth(t_s=t_s, x_map_m=0.0, y_map_m=y_m, yaw_map_rad=math.pi / 2.0, v_mps=v_mps,
                         yaw_rate_radps=0.0, roll_rad=0.0, pitch_rad=0.0))  # fmt: skip
    (visit,) = log.visits
    return visit, visitor


def test_it_crosses_the_robots_line_where_it_was_aimed_if_the_robot_drives_on(
    rover: RobotSpec,
) -> None:
    visit, visitor = meet(rover, {0.0: 0.5, 5.0: 0.4})
    own = measure_robot_outline(rover)
    front_m = own.x_m + own.half_x_m
    then_m = 5.0 * 0.5 + ASIDE_M / PLAN.speed_mps * 0.4 + front_m
    x_m, y_m, yaw_rad = visitor.find_place(AT_CROSSING_S)
    assert (x_m, y_m - then_m) == pytest.approx((0.0, PLAN.ahead_m), abs=0.05)
    assert math.sin(yaw_rad) == pytest.approx(0.0, abs=1e-9), "it walks straight across, from left"
    assert visitor.find_place(PLAN.begin_s + 0.1)[0] < -ASIDE_M + 0.2
    assert visitor.find_place(visit.end_s + 0.1)[0] == PARKED_M


def test_a_robot_that_drives_on_touches_it_at_its_speed(rover: RobotSpec) -> None:
    visit, _ = meet(rover, {0.0: 0.4})
    assert (visit.robot_mps, visit.touched_mps) == pytest.approx((0.4, 0.4))
    assert visit.nearest_m == 0.0 and visit.stood_m is None
    own = measure_robot_outline(rover)
    assert visit.touched_ahead_m == pytest.approx(own.x_m + own.half_x_m + 0.2, abs=0.02)


def test_a_robot_that_stands_in_time_keeps_its_distance(rover: RobotSpec) -> None:
    visit, _ = meet(rover, {0.0: 0.4, AT_CROSSING_S - 0.5: 0.0})
    assert visit.touched_mps is None
    assert visit.nearest_m == pytest.approx(PLAN.ahead_m + 0.5 * 0.4 - 0.2, abs=0.03)
    assert visit.stood_m == visit.nearest_m


def test_who_walks_into_a_robot_that_stands_was_not_touched_by_it(rover: RobotSpec) -> None:
    plan = msgspec.structs.replace(PLAN, ahead_m=-0.3)
    visitor = Visitor(name="post", kind="dog", shapes=(POST,), waypoints=(FAR,), plan=plan, way=[])
    log = VisitLog(rover, [visitor])
    for tick in range(1, 600):
        log.update(Truth(t_s=tick * TICK_S, x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0, v_mps=0.0,
                         yaw_rate_radps=0.0, roll_rad=0.0, pitch_rad=0.0))  # fmt: skip
    assert log.visits[0].touched_mps == 0.0


def test_what_a_seed_draws_repeats_and_is_within_its_bounds() -> None:
    plans = draw_plans(100, seed=3)
    assert plans == draw_plans(100, seed=3) != draw_plans(100, seed=4)
    assert plans[:10] == draw_plans(10, seed=3), "more visitors leave the first as they were"
    assert {plan.figure for plan in plans} == set(SPEEDS_MPS) <= set(FIGURES)
    assert {plan.side for plan in plans} == {1, -1}
    for plan in plans:
        low_mps, high_mps = SPEEDS_MPS[plan.figure]
        assert low_mps <= plan.speed_mps <= high_mps
        assert AHEAD_M[0] <= plan.ahead_m <= AHEAD_M[1]


@pytest.mark.parametrize("figure", sorted(SPEEDS_MPS))
def test_the_plane_of_the_lidar_that_a_setting_adds_meets_every_figure(figure: str) -> None:
    heights_m = []
    for shape in load_figure(figure):
        pose = shape.origin.matrix()
        long_m = shape.size_m[2 if shape.kind == "box" else 1] if shape.kind != "sphere" else 0.0
        reach_m = abs(pose[2, 2]) * long_m / 2.0
        heights_m.append((pose[2, 3] - reach_m, pose[2, 3] + reach_m))
    assert any(low_m < 0.45 < high_m for low_m, high_m in heights_m)


def test_a_visitor_of_a_simulated_world_is_seen_by_the_lidar_and_reported(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    settings = RunConfig(
        perception=PerceptionConfig(enabled=False), sim=SimConfig(sensors="ideal", visitors=1)
    )
    world = add_visitors(meadow, 1, seed=1, load_figure=load_figure)
    (walker,) = world.walkers
    assert isinstance(walker, Visitor)
    platform = SimPlatform(settings, fit_lidar(rover), world)
    plan, seen_m = walker.plan, []
    for _ in range(round((plan.begin_s + ASIDE_M / plan.speed_mps) / TICK_S)):
        seen_m += [float(np.nanmin(scan.ranges_m)) for scan in platform.read().scans]
    (visit,) = platform.visits
    assert visit.figure == plan.figure and visit.touched_mps is None
    assert math.isinf(seen_m[0])
    assert seen_m[-1] == pytest.approx(plan.ahead_m, abs=0.6)
