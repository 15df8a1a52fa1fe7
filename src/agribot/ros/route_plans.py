"""Routes that peers ask for: worked out by the robot's own planner, and not driven.

Source: marti_nav_msgs/PlanRoute, which mapviz's plan_route calls.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any

import msgspec

from agribot.autonomy.plan.ways.curves import SPACING_M, Place
from agribot.core.errors import BridgeError, MissionError
from agribot.core.geo import wrap_rad
from agribot.core.messages import Estimate, Path
from agribot.ros.frames import PeerFrames
from agribot.ros.messages.rosmsg import make_path
from agribot.ros.requests import Requests

PLAN_SERVICE = "/agribot/plan_route"
_MOST_PLACES = 50


class RoutePlan(msgspec.Struct, frozen=True):
    """The poses of a route in the requested frame, and its length; or the reason without one.

    A pose is a geometry_msgs/Pose of ROS 2.
    """

    poses: Sequence[Any] = ()
    length_m: float = 0.0
    refusal: str = ""


class RoutePlanner:
    """Plans from any thread, one route at a time."""

    def __init__(self, requests: Requests) -> None:
        self._requests = requests
        self._frames = requests.frames or PeerFrames()
        self._lock = threading.Lock()

    def plan(self, frame: str, poses: Sequence[Any], source: str, *, from_robot: bool) -> RoutePlan:
        """Plan through geometry_msgs/Pose in a frame, from the robot or from the first of them."""
        try:
            with self._lock:
                legs = self._plan_legs(frame, poses, from_robot=from_robot)
            return RoutePlan(self._convert(frame, legs), sum(float(leg.s_m[-1]) for leg in legs))
        except (BridgeError, MissionError) as error:
            self._requests.refuse(f"{source}: no route: {error}")
            return RoutePlan(refusal=str(error))

    def _plan_legs(self, frame: str, poses: Sequence[Any], *, from_robot: bool) -> list[Path]:
        plan_way, here = self._requests.plan_way, self._read_estimate(from_robot=from_robot)
        if plan_way is None:
            raise BridgeError("this robot has no planner; start it with a mission")
        if not 0 < len(poses) <= _MOST_PLACES:
            raise BridgeError(f"{len(poses)} waypoints; give 1 to {_MOST_PLACES}")
        places = [self._frames.find_pose(frame, pose) for pose in poses]
        if not from_robot:
            here = _stand_at_first(here, places)
        legs = list[Path]()
        for place in places if from_robot else places[1:]:
            if math.dist(place[:2], (here.x_map_m, here.y_map_m)) < SPACING_M:
                continue
            legs.append(plan_way(here, place))
            here = _stand_at_end(here, legs[-1])
        if not legs:
            raise BridgeError("the route has no length; give a place further away")
        return legs

    def _read_estimate(self, *, from_robot: bool) -> Estimate:
        record = self._requests.link.record if self._requests.link else None
        if record is None or (from_robot and not record.estimate.ok):
            raise BridgeError("the robot knows neither place nor heading yet; wait until it does")
        return record.estimate

    def _convert(self, frame: str, legs: Sequence[Path]) -> list[Any]:
        """List the poses of the legs, in the frame; where two meet, one stands for both."""
        first, *others = (make_path(0.0, leg).poses for leg in legs)
        stamped = [*first, *(each for poses in others for each in poses[1:])]
        return [self._frames.place_pose(frame, each.pose) for each in stamped]


def _stand_at_first(here: Estimate, places: Sequence[Place]) -> Estimate:
    """Begin at the first place, and where its heading is open look at the second."""
    if len(places) < 2:
        raise BridgeError("a route of one waypoint; give two, or set plan_from_vehicle")
    (x_m, y_m, yaw_rad), after = places[0], places[1]
    if yaw_rad is None:
        yaw_rad = math.atan2(after[1] - y_m, after[0] - x_m)
    return _move(here, x_m, y_m, yaw_rad)


def _stand_at_end(here: Estimate, leg: Path) -> Estimate:
    (x_m, y_m), yaw_rad = leg.xy_map_m[-1], leg.yaw_map_rad[-1]
    return _move(here, x_m, y_m, yaw_rad)


def _move(here: Estimate, x_m: float, y_m: float, yaw_rad: float) -> Estimate:
    return msgspec.structs.replace(
        here, x_map_m=float(x_m), y_map_m=float(y_m), yaw_map_rad=wrap_rad(float(yaw_rad))
    )
