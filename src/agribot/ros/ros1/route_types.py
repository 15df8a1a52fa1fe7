"""marti_nav_msgs/PlanRoute of ROS 1: its type, and its request and response as bytes."""

from __future__ import annotations

import functools
import hashlib
from typing import Any

from rosbags.typesys.store import Typestore

from agribot.ros.decoding import make_undecodable
from agribot.ros.ros1.service_server import ServiceType
from agribot.ros.ros1.types import add_ros1_types, load_ros1_types
from agribot.ros.route_plans import RoutePlan

_REQUEST = "marti_nav_msgs/msg/PlanRouteRequest"
_RESPONSE = "marti_nav_msgs/msg/PlanRouteResponse"
_TEXTS = {
    _REQUEST: "Header header\ngeometry_msgs/Pose[] waypoints\nbool plan_from_vehicle\n",
    _RESPONSE: "Route route\nbool success\nstring message\n",
}
# Words in a line of a type in place of a message, by the name of the field.
_MESSAGES = {
    "header": "std_msgs/msg/Header",
    "waypoints": "geometry_msgs/msg/Pose",
    "route": "marti_nav_msgs/msg/Route",
    "properties": "marti_common_msgs/msg/KeyValue",
}


class NestedServiceType(ServiceType):
    """A type whose fields are messages: their own sums stand for them in its sum."""

    __slots__ = ()

    @property
    def md5(self) -> str:
        texts = ("\n".join(map(_sum_line, part.splitlines())) for part in self[1:])
        return hashlib.md5("".join(texts).encode(), usedforsecurity=False).hexdigest()


PLAN_ROUTE = NestedServiceType("marti_nav_msgs/PlanRoute", *_TEXTS.values())


def read_request(data: bytes) -> Any:
    """Read the header, the waypoints and whether to begin at the robot.

    Raises: BridgeError: the bytes are no request.
    """
    try:
        return _load_types().deserialize_ros1(data, _REQUEST)
    except Exception as error:  # the generated code of rosbags raises any error
        raise make_undecodable(data, f"a request of {PLAN_ROUTE.name}") from error


def pack_response(header: Any, plan: RoutePlan) -> bytes:
    """Pack the route in the frame of the request's header, or the reason without one."""
    make = _load_types().types
    points = [
        make["marti_nav_msgs/msg/RoutePoint"](pose, str(number), [])
        for number, pose in enumerate(plan.poses)
    ]
    route = make["marti_nav_msgs/msg/Route"](header, points, [])
    response = make[_RESPONSE](route, not plan.refusal, plan.refusal)
    return bytes(_load_types().serialize_ros1(response, _RESPONSE))


@functools.cache
def _load_types() -> Typestore:
    return add_ros1_types(_TEXTS)


def _sum_line(line: str) -> str:
    """Give the line as it counts in a sum, with the sum of a message in place of its type."""
    name = line.split()[1]
    if name not in _MESSAGES:
        return line
    _, md5 = load_ros1_types().generate_msgdef(_MESSAGES[name], ros_version=1)
    return f"{md5} {name}"
