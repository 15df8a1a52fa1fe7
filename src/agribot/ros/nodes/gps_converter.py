"""`gps-converter`: fixes in; pose in the map, distance and bearing to the goal out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from agribot.autonomy.estimate.sensors.pole_origin import PoleOrigin
from agribot.core import topics
from agribot.core.geo import MapFrame, is_place, make_datum
from agribot.core.topics import Topic
from agribot.ros.messages import rosmsg
from agribot.ros.messages.rosmsg import to_seconds
from agribot.ros.nodes.stage import EndlessStage, OutgoingMessage

_NO_FIX, _RTK = -1, 2  # sensor_msgs/NavSatStatus: STATUS_NO_FIX, STATUS_GBAS_FIX


class GpsConverter(EndlessStage):
    """Publishes a pose with a position only; its orientation is that of the map.

    `waits_for_pole` latches the origin to the pole; otherwise the first fix is the origin.
    """

    inputs = (topics.FIX, topics.POLE_FIX, topics.GOAL_FIX)
    outputs = (topics.POSE, topics.DISTANCE, topics.BEARING)

    def __init__(self, origin: PoleOrigin, *, waits_for_pole: bool) -> None:
        self._origin, self._waits = origin, waits_for_pole
        self._goal: tuple[float, float] | None = None
        self._first_frame: MapFrame | None = None
        self.reason = f"no {topics.FIX.name} yet"

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        place = (float(message.latitude), float(message.longitude), float(message.altitude))
        if topic is topics.GOAL_FIX:
            if is_place(*place[:2]):
                self._goal = place[:2]
            return ()
        if message.status.status <= _NO_FIX or not is_place(*place[:2]):
            return ()
        stamp_s = to_seconds(message.header.stamp)
        if topic is topics.POLE_FIX:
            self._origin.update_pole(stamp_s, place)
            return ()
        if message.status.status < _RTK:  # a receiver with carrier corrections needs no pole
            place = self._origin.correct(stamp_s, place) or place
        return self._report_place(stamp_s, place)

    def _report_place(
        self, stamp_s: float, place: tuple[float, float, float]
    ) -> Sequence[OutgoingMessage]:
        frame = self._origin.frame or self._first_frame
        if frame is None and self._waits:
            self.reason = f"the origin is not known: no {topics.POLE_FIX.name} for long enough"
            return ()
        if frame is None:
            lat_deg, lon_deg, alt_m = place
            frame = MapFrame(make_datum(lat_deg, math.remainder(lon_deg, 360.0), alt_m))
            self._first_frame = frame
        x_m, y_m, _ = frame.map_from_geodetic(*place)
        head = rosmsg.make_header(stamp_s, rosmsg.MAP_FRAME)
        pose = rosmsg.make_message(
            "geometry_msgs/msg/PoseStamped", head, rosmsg.make_pose(x_m, y_m, 0.0)
        )
        messages = [OutgoingMessage(topics.POSE, pose)]
        if self._goal is None:
            self.reason = f"no {topics.GOAL_FIX.name} yet"
            return messages
        self.reason = ""
        goal_x_m, goal_y_m, _ = frame.map_from_geodetic(*self._goal, frame.datum.alt_m)
        dx_m, dy_m = goal_x_m - x_m, goal_y_m - y_m
        bearing_deg = math.degrees(math.atan2(dy_m, dx_m))
        messages.append(
            OutgoingMessage(topics.DISTANCE, rosmsg.make_float64(math.hypot(dx_m, dy_m)))
        )
        messages.append(OutgoingMessage(topics.BEARING, rosmsg.make_float64(bearing_deg)))
        return messages
