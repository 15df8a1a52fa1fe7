"""Places of peers in the robot's map, from the frames that a peer may name."""

from __future__ import annotations

import math
from typing import Any

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.geo import Datum, MapFrame, is_place, wrap_rad
from agribot.core.pose import Pose2
from agribot.core.topics import Topic
from agribot.ros.messages.rosmsg import (
    MAP_FRAME,
    ODOM_FRAME,
    load_types,
    make_message,
    make_point,
    make_pose,
)

EARTH_FRAME = "wgs84"  # frame with x the longitude and y the latitude in degrees, as in mapviz
POSE = "geometry_msgs/msg/Pose"
KNOWN = (MAP_FRAME, ODOM_FRAME, EARTH_FRAME)
_LEAST_NORM = 1e-3  # least norm of a quaternion: less is one that was left out
_NORM_TOLERANCE = 0.05


class PeerFrames:
    """Converts to the map; `datum` is the map's origin on Earth, None where it has no place there.

    `note` takes what the run publishes, and keeps the newest map -> odom.
    """

    def __init__(self, datum: Datum | None = None) -> None:
        self._earth = MapFrame(datum) if datum else None
        self._odom_tf = b""

    def note(self, topic: Topic, data: bytes) -> None:
        if topic.name == topics.TF.name and _ODOM_NAME in data:
            self._odom_tf = data

    def find_place(self, frame: str, x: float, y: float) -> tuple[float, float]:
        """Convert a point of a frame to x and y in the map, m.

        Raises: BridgeError: not finite, or the frame is unknown.
        """
        return self._find_pose(frame, x, y)[:2]

    def find_pose(self, frame: str, pose: Any) -> tuple[float, float, float | None]:
        """Convert a geometry_msgs/Pose to x, y (m) and yaw (rad) in the map.

        The yaw is None where the quaternion is all zeros, which is one that was left out.
        Raises: BridgeError: not finite, the frame is unknown, or the quaternion is invalid.
        """
        x_m, y_m, turn_rad = self._find_pose(frame, pose.position.x, pose.position.y)
        yaw_rad = read_yaw(pose.orientation)
        return x_m, y_m, None if yaw_rad is None else wrap_rad(yaw_rad + turn_rad)

    def place_pose(self, frame: str, pose: Any) -> Any:
        """Convert a geometry_msgs/Pose of the map to a frame that `find_pose` takes.

        Raises: BridgeError: the frame is unknown.
        """
        x_m, y_m = pose.position.x, pose.position.y
        name = frame.lstrip("/")
        if name == EARTH_FRAME and self._earth is not None:
            lat_deg, lon_deg, _ = self._earth.geodetic_from_map(x_m, y_m)
            return make_message(POSE, make_point(lon_deg, lat_deg), pose.orientation)
        if name == ODOM_FRAME:
            map_from_odom = self._read_odom()
            yaw_rad = (read_yaw(pose.orientation) or 0.0) - map_from_odom.yaw_rad
            return make_pose(*map_from_odom.locate(x_m, y_m), yaw_rad)
        return pose

    def _find_pose(self, frame: str, x: float, y: float) -> tuple[float, float, float]:
        """Convert to x, y and how far the frame is turned in the map."""
        if not (math.isfinite(x) and math.isfinite(y)):
            raise BridgeError(f"the position {x:g}, {y:g} is not finite; send finite numbers")
        name = frame.lstrip("/")
        if name in {"", MAP_FRAME}:
            return x, y, 0.0
        if name == EARTH_FRAME:
            return (*self._from_earth(x, y), 0.0)
        if name == ODOM_FRAME:
            map_from_odom = self._read_odom()
            x_m, y_m = map_from_odom.transform(x, y)
            return x_m, y_m, map_from_odom.yaw_rad
        raise BridgeError(f"frame '{name[:80]}' is unknown; use one of {', '.join(KNOWN)}")

    def _from_earth(self, lon_deg: float, lat_deg: float) -> tuple[float, float]:
        if self._earth is None:
            raise BridgeError("this map has no place on Earth; give the goal in the frame map")
        if not is_place(lat_deg, lon_deg):
            raise BridgeError(
                f"latitude {lat_deg:g}, longitude {lon_deg:g} is no place; in the frame "
                f"{EARTH_FRAME} x is the longitude and y the latitude in degrees"
            )
        return self._earth.map_from_geodetic(lat_deg, lon_deg, math.nan)[:2]

    def _read_odom(self) -> Pose2:
        if not self._odom_tf:
            raise BridgeError("nothing is known of odom yet; wait for the first /tf")
        message: Any = load_types().deserialize_cdr(self._odom_tf, topics.TF.ros_type)
        for stamped in message.transforms:
            pair = (stamped.header.frame_id, stamped.child_frame_id)
            if pair == (MAP_FRAME, ODOM_FRAME):
                place, turn = stamped.transform.translation, stamped.transform.rotation
                return Pose2(place.x, place.y, read_yaw(turn) or 0.0)
        raise BridgeError("/tf has no map -> odom; give the goal in the frame map")


_ODOM_NAME = ODOM_FRAME.encode() + b"\0"


def read_yaw(quaternion: Any) -> float | None:
    """Read the yaw (rad) of a rotation about the vertical; None if all of it is zero.

    Raises: BridgeError: not finite, or not of length 1.
    """
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if norm < _LEAST_NORM:
        return None
    if not abs(norm - 1.0) < _NORM_TOLERANCE:  # written this way, NaN is refused, too
        raise BridgeError(
            f"the orientation {x:g}, {y:g}, {z:g}, {w:g} has not the length 1; normalise it"
        )
    return math.atan2(2.0 * (w * z + x * y), norm * norm - 2.0 * (y * y + z * z))
