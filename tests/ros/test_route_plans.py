"""Routes that peers ask for: through all places, in the frame of the request, and not driven."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest

from agribot.autonomy.plan.ways.curves import Place
from agribot.autonomy.plan.ways.waypoints import plan_waypoints
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import Said
from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import Estimate, Inbox, Path
from agribot.description.loader import load_robot
from agribot.ros.frames import PeerFrames
from agribot.ros.messages import rosmsg
from agribot.ros.requests import Requests
from agribot.ros.robot_link import RobotLink
from agribot.ros.ros1.route_types import PLAN_ROUTE
from agribot.ros.route_plans import RoutePlan, RoutePlanner
from tests.ros.test_inbound import HERE, tick

DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022, alt_m=4.5)
ROBOT, MISSION = load_robot(), MissionConfig()
FENCE_M = 50.0


def plan_way(here: Estimate, goal: Place) -> Path:
    if max(map(abs, goal[:2])) > FENCE_M:
        raise MissionError(Said("beyond the fence"))
    pose = (here.x_map_m, here.y_map_m, here.yaw_map_rad)
    return plan_waypoints((goal[:2],), pose, ROBOT, MISSION)


def make_planner(*, is_running: bool = True) -> tuple[RoutePlanner, Inbox]:
    inbox = Inbox()
    link = RobotLink(inbox)
    if is_running:
        link(tick())
    requests = Requests(inbox, link=link, frames=PeerFrames(DATUM), plan_way=plan_way)
    return RoutePlanner(requests), inbox


def at(x: float, y: float) -> Any:
    """A pose that leaves open how the robot looks."""
    nothing = rosmsg.make_quaternion((0.0, 0.0, 0.0, 0.0))
    return rosmsg.make_message("geometry_msgs/msg/Pose", rosmsg.make_point(x, y), nothing)


def ask(frame: str, *poses: Any, from_robot: bool = True, is_running: bool = True) -> RoutePlan:
    """Ask for a route, for which nothing is asked of the robot."""
    planner, inbox = make_planner(is_running=is_running)
    plan = planner.plan(frame, poses, "ROS 1 node /mapviz", from_robot=from_robot)
    assert inbox.drain(1.0) == ((), ())
    return plan


def list_places(plan: RoutePlan) -> list[tuple[float, float]]:
    return [(pose.position.x, pose.position.y) for pose in plan.poses]


def test_a_route_leads_from_the_robot_through_every_place_in_small_steps() -> None:
    plan = ask("map", at(8.0, 0.0), at(12.0, 4.0))
    places = list_places(plan)
    assert places[0] == pytest.approx(HERE[:2])
    assert min(math.dist(place, (8.0, 0.0)) for place in places) < 0.05
    assert places[-1] == pytest.approx((12.0, 4.0), abs=1e-6)
    steps_m = [math.dist(a, b) for a, b in itertools.pairwise(places)]
    assert min(steps_m) > 0.0
    assert max(steps_m) < 0.15
    assert plan.length_m == pytest.approx(sum(steps_m), rel=0.01)


def test_without_the_robot_a_route_begins_at_its_first_place_and_looks_at_the_second() -> None:
    plan = ask("map", at(5.0, 5.0), at(5.0, 9.0), from_robot=False)
    assert list_places(plan)[0] == pytest.approx((5.0, 5.0))
    assert rosmsg.quaternion_from_yaw(math.pi / 2.0)[3] == pytest.approx(
        plan.poses[0].orientation.w
    )
    assert plan.length_m == pytest.approx(4.0)


def test_a_route_of_mapviz_is_longitude_and_latitude() -> None:
    lat_deg, lon_deg, _ = MapFrame(DATUM).geodetic_from_map(8.0, 0.0)
    plan = ask("wgs84", at(lon_deg, lat_deg))
    assert list_places(plan)[-1] == pytest.approx((lon_deg, lat_deg), abs=1e-9)
    lon_deg, lat_deg = list_places(plan)[0]
    x_m, y_m, _ = MapFrame(DATUM).map_from_geodetic(lat_deg, lon_deg, math.nan)
    assert (x_m, y_m) == pytest.approx(HERE[:2], abs=1e-3)


@pytest.mark.parametrize(
    ("frame", "poses", "options", "why"),
    [
        ("map", (at(900.0, 0.0),), {}, "beyond the fence"),
        ("moon", (at(1.0, 0.0),), {}, "frame 'moon' is unknown; use one of map, odom, wgs84"),
        ("map", (), {}, "0 waypoints; give 1 to 50"),
        ("map", (at(math.nan, 0.0),), {}, "is not finite"),
        (
            "map",
            (at(1.0, 0.0),),
            {"from_robot": False},
            "of one waypoint; give two, or set plan_from",
        ),
        ("map", (at(*HERE[:2]),), {}, "the route has no length"),
        ("map", (at(1.0, 0.0),), {"is_running": False}, "neither place nor heading yet"),
    ],
)
def test_what_cannot_be_planned_is_refused_with_the_reason(
    frame: str, poses: tuple[Any, ...], options: dict[str, bool], why: str
) -> None:
    plan = ask(frame, *poses, **options)
    assert why in plan.refusal and not plan.poses


def test_the_service_of_ros1_is_that_of_marti_nav_msgs() -> None:
    """The sum that its own generated code has (marti_messages 0.8.0)."""
    assert PLAN_ROUTE.md5 == "fc2df8428924c01b72b355fa8fd38799"
