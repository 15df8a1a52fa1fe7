from __future__ import annotations

import math
from itertools import pairwise
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from agribot.autonomy.plan.ways.certify import certify
from agribot.autonomy.plan.ways.waypoints import plan_waypoints
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import Fact, NoWaypoints, WaypointFar, WaypointsSame
from tests.autonomy.plan.planting import MISSION
from tests.finding import is_like, refused
from tests.robot_parts import plain_rover

place = st.tuples(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0))


@settings(max_examples=60, deadline=None)
@given(
    points=st.lists(place, min_size=1, max_size=6),
    start=place,
    yaw_rad=st.floats(-math.pi, math.pi),
)
def test_any_list_is_visited_in_order_on_a_drivable_path(
    points: list[tuple[float, float]], start: tuple[float, float], yaw_rad: float
) -> None:
    chain = [start, *points]
    assume(all(math.dist(a, b) > 0.2 for a, b in pairwise(chain)))
    path = plan_waypoints(points, (*start, yaw_rad), plain_rover(), MISSION)
    certify(path, (), plain_rover(), MISSION.plant_clearance_m)
    first = 0
    for point in points:
        away_m = np.hypot(*(path.xy_map_m[first:] - np.array(point)).T)
        near = away_m <= 0.7 * MISSION.waypoint_radius_m
        assert near.any()
        first += int(np.argmax(near))
    assert path.xy_map_m[-1] == pytest.approx(points[-1], abs=1e-5)


def test_legs_between_far_waypoints_are_straight() -> None:
    path = plan_waypoints([(0.0, 5.0), (8.0, 5.0)], (0.0, 0.0, math.pi / 2), plain_rover(), MISSION)
    middle = (path.xy_map_m[:, 0] > 2.0) & (path.xy_map_m[:, 0] < 8.0)
    assert np.abs(path.xy_map_m[middle, 1] - 5.0).max() < 1e-6


def test_gentle_corners_are_rounded_inside_the_waypoint_radius() -> None:
    path = plan_waypoints([(4.0, 0.0), (8.0, 1.0)], (0.0, 0.0, 0.0), plain_rover(), MISSION)
    cut_m = np.hypot(*(path.xy_map_m - np.array([4.0, 0.0])).T).min()
    assert 0.001 < cut_m <= MISSION.waypoint_radius_m / 2
    assert path.s_m[-1] < 4.0 + math.hypot(4.0, 1.0)


def test_waypoint_ten_kilometres_away_is_refused_with_distance_and_limit() -> None:
    with refused(WaypointFar(2, ANY, 10_000.0, 1000.0)):
        plan_waypoints([(1.0, 0.0), (0.0, 1e4)], (0.0, 0.0, 0.0), plain_rover(), MISSION)


def refuse(points: list[tuple[float, float]], mission: MissionConfig) -> Fact:
    with pytest.raises(MissionError) as refused:
        plan_waypoints(points, (0.0, 0.0, 0.0), plain_rover(), mission)
    return refused.value.fact


def test_limit_of_the_distance_is_a_setting() -> None:
    short = msgspec.structs.replace(MISSION, max_waypoint_distance_m=3.0)
    assert refuse([(4.0, 0.0)], short) == WaypointFar(1, plain_rover().name, 4.0, 3.0)


def test_nan_is_never_near_enough() -> None:
    assert is_like(refuse([(math.nan, 0.0)], MISSION), WaypointFar(1, ANY, math.nan, ANY))


@pytest.mark.parametrize(
    ("points", "complaint"),
    [([], NoWaypoints()), ([(1.0, 0.0), (1.0, 0.0)], WaypointsSame(1, 2))],
)
def test_useless_lists_are_refused(points: list[tuple[float, float]], complaint: Fact) -> None:
    assert refuse(points, MISSION) == complaint


def test_a_waypoint_under_the_robot_costs_no_loop() -> None:
    path = plan_waypoints([(0.0, 0.01), (5.0, 0.0)], (0.0, 0.0, 0.0), plain_rover(), MISSION)
    assert path.s_m[-1] == pytest.approx(5.0, abs=0.01)
