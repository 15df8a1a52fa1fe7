"""marti_nav_msgs/PlanRoute of ROS 2, with the cost of the route and, as it was before, without."""

from __future__ import annotations

import functools
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agribot.ros.messages.char_types import replace_char
from agribot.ros.messages.gps_types import read_shipped_texts
from agribot.ros.ros2.services import add_service
from agribot.ros.route_plans import RoutePlan

PLAN_ROUTE = "marti_nav_msgs/srv/PlanRoute"
_REQUEST = "std_msgs/Header header\ngeometry_msgs/Pose[] waypoints\nbool plan_from_vehicle\n"
_RESPONSE = "marti_nav_msgs/Route route\nbool success\nstring message\n"


@functools.cache
def load_route_types(*, has_cost: bool) -> Typestore:
    """Load the types of Jazzy with the service; its hash distinguishes the two forms."""
    store = get_typestore(Stores.ROS2_JAZZY)
    replace_char(store)
    for name, text in read_shipped_texts().items():
        if name.startswith(("marti_nav_msgs/", "marti_common_msgs/")):
            store.register(get_types_from_msg(text, name))
    add_service(store, PLAN_ROUTE, _REQUEST, _RESPONSE + ("float64 cost\n" if has_cost else ""))
    return store


def make_response(header: Any, plan: RoutePlan, *, has_cost: bool) -> tuple[Any, ...]:
    """Make the fields of the response; the cost is the length in metres."""
    make = load_route_types(has_cost=has_cost).types
    points = [
        make["marti_nav_msgs/msg/RoutePoint"](pose, str(number), [])
        for number, pose in enumerate(plan.poses)
    ]
    route = make["marti_nav_msgs/msg/Route"](header, points, [])
    fields = (route, not plan.refusal, plan.refusal)
    return (*fields, plan.length_m) if has_cost else fields
