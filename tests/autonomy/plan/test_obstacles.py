"""What stands in a field is driven around, at a distance that counts from the robot's body."""

from __future__ import annotations

import math
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.app.tasks import TasksUnderWay, choose_task
from agribot.autonomy.plan.ways.boustrophedon import plan_home, plan_rows
from agribot.autonomy.plan.ways.curves import Segment, sample
from agribot.autonomy.plan.ways.goal_way import plan_to_place
from agribot.autonomy.plan.ways.obstacles import Obstacles, make_obstacles
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core import config
from agribot.core.facts import BeyondFence, NearObstacle, NoClearWay, OnCropThere
from agribot.core.messages import Estimate, FloatArray, Path
from agribot.core.pose import Pose2
from agribot.description.loader import load_robot
from tests.autonomy.plan.planting import FARM, FARM_START, MISSION, at
from tests.finding import refused
from tests.robot_parts import plain_rover

CLEARANCE_M = 0.3
ROWS = lay_rows(FARM)
FENCE = (-10.0, -10.0, 20.0, 20.0)


def at_start() -> Estimate:
    x_m, y_m, yaw_rad = FARM_START
    return msgspec.structs.replace(at(x_m, y_m, 0.0), yaw_map_rad=yaw_rad)


def posts(*circles: tuple[float, float, float]) -> Obstacles:
    return make_obstacles(circles, CLEARANCE_M, load_robot())


def straight(length_m: float) -> Path:
    return sample(Pose2(0.0, 0.0, 0.0), (Segment(length_m, 0.0),))


def body_corners_m(path: Path, around: Obstacles) -> FloatArray:
    """Points on the edge of the body along the path, (N, 2): no formula of the planner."""
    body, share = around.body, np.linspace(-1.0, 1.0, 41)
    ahead = np.concatenate([np.where(share > 0, share * body.front_m, share * body.rear_m)] * 2
                           + [np.full(41, body.front_m), np.full(41, -body.rear_m)])  # fmt: skip
    left = body.half_width_m * np.concatenate([np.ones(41), -np.ones(41), share, share])
    cos, sin = np.cos(path.yaw_map_rad)[:, None], np.sin(path.yaw_map_rad)[:, None]
    x_m = path.xy_map_m[:, :1] + cos * ahead - sin * left
    y_m = path.xy_map_m[:, 1:] + sin * ahead + cos * left
    return np.stack([x_m.ravel(), y_m.ravel()], axis=1)


def smallest_gap_m(path: Path, around: Obstacles) -> float:
    edge = body_corners_m(path, around)
    return min(
        float(np.hypot(edge[:, 0] - c.x_m, edge[:, 1] - c.y_m).min()) - c.radius_m
        for c in around.circles
    )


@pytest.mark.parametrize("east_m", [-0.4, -0.1, 0.0, 0.2, 0.5])
@pytest.mark.parametrize("north_m", [-0.6, 0.0, 0.3])
def test_the_first_row_is_reached_around_a_post_in_the_way(east_m: float, north_m: float) -> None:
    around = posts((east_m, north_m, 0.05))
    path = plan_rows(ROWS, FARM_START, plain_rover(), MISSION, (), around)
    assert smallest_gap_m(path, around) >= CLEARANCE_M - 0.01
    assert set(path.row.tolist()) == {-1, *range(6)}


def test_the_farm_knows_the_pole_of_its_base_station() -> None:
    farm, robot = config.load("farm", []), load_robot()
    assert farm.field.obstacles_map_m == ((0.0, 0.0, 0.05),)
    path = choose_task(farm, robot).plan(at_start())
    assert smallest_gap_m(path, posts((0.0, 0.0, 0.05))) >= farm.mission.obstacle_clearance_m


def test_a_post_in_the_middle_is_not_straddled() -> None:
    around = posts((1.0, 0.0, 0.05))
    with refused(NearObstacle(ANY, ANY, ANY, 1.0, 0.0, 0.3)):
        around.check(straight(2.0))


@pytest.mark.parametrize(("beside_m", "is_clear"), [(0.74, False), (0.78, True)])
def test_the_distance_counts_from_the_side_of_the_body(beside_m: float, is_clear: bool) -> None:
    """Half a width of 0.416 m, the clearance and the radius of the post: 0.766 m."""
    assert posts((1.0, beside_m, 0.05)).are_clear_of(straight(2.0)) is is_clear
    assert posts((1.0, -beside_m, 0.05)).are_clear_of(straight(2.0)) is is_clear


def test_a_post_on_a_row_refuses_the_mission_with_its_place() -> None:
    farm = config.load("farm", ["field.obstacles_map_m=[[3.0,7.0,0.1]]"])
    with refused(NearObstacle(ANY, ANY, ANY, 3.0, 7.0, ANY)):
        choose_task(farm, load_robot()).plan(at_start())


def test_waypoints_past_a_post_are_refused_with_its_place() -> None:
    field = msgspec.structs.replace(FARM, obstacles_map_m=((2.0, 0.3, 0.1),))
    settings = config.RunConfig(field=field, mission=MISSION)
    listed = choose_task(settings, load_robot(), waypoints_map_m=((4.0, 0.0),))
    visit = TasksUnderWay(listed, settings, load_robot()).visit(((4.0, 0.0),), "visit", None)
    for task in (listed, visit):
        with refused(NearObstacle(ANY, ANY, ANY, 2.0, 0.3, ANY)):
            task.plan(at(0.0, 0.0, 0.0))


def test_a_visit_plans_a_route_for_others_off_the_crop_and_inside_its_fence() -> None:
    settings = config.load("farm")
    farm = choose_task(settings, load_robot())
    visit = TasksUnderWay(farm, settings, load_robot()).visit(((-3.0, 3.0),), "visit", None)
    path = visit.plan_to(at(-3.0, 1.0, 0.0), (-2.0, 3.0, None))
    assert path.xy_map_m[-1] == pytest.approx((-2.0, 3.0), abs=0.01)
    refusals = (((1.4, 4.0), OnCropThere(1.4, 4.0)), ((300.0, 7.0), BeyondFence(300.0, 7.0, ANY)))
    for place, why in refusals:
        with refused(why):
            visit.plan_to(at(-3.0, 1.0, 0.0), (*place, None))
    assert not visit.has_ways  # it drives none of them


def test_ways_home_and_to_places_lead_around_too() -> None:
    around = posts((-1.0, 1.0, 0.1))
    home = plan_home(ROWS, (1.0, 1.0, -math.pi / 2), FARM_START, plain_rover(), MISSION, around)
    assert smallest_gap_m(home, around) >= CLEARANCE_M - 0.01
    place = plan_to_place((-2.0, 3.0, None), (0.0, -1.0, 2.2), ROWS, FENCE, plain_rover(), MISSION,
                          around)  # fmt: skip
    assert smallest_gap_m(place, around) >= CLEARANCE_M - 0.01


def test_a_robot_that_stands_against_a_post_is_told_why_it_stays() -> None:
    with refused(NoClearWay(*FARM_START[:2], ANY, 0.3)):
        plan_rows(ROWS, FARM_START, plain_rover(), MISSION, (), posts((-2.0, 0.5, 0.05)))
