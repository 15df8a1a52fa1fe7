"""ROS messages as the page's displays read them: JSON, thinned to what a browser can draw.

What is left out is said in words. Frames are resolved here; a display only adds the robot's pose.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agribot.core.errors import BridgeError
from agribot.core.messages import FloatArray
from agribot.ros.messages.frame_tree import clean_name
from agribot.ros.messages.shown_pictures import show_compressed, show_disparity, show_image
from agribot.ros.messages.shown_types import SHOWN_TYPES

MOST_BEAMS = 4000
MOST_CLOUD_POINTS = 20_000
MOST_POINTS = 5000  # points of a path or route
MOST_TEXT = 200_000
_MOST_FIELDS = 4  # fields of a cloud, besides the place
# Types of PointField.
_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_FLOAT32, _UINT32 = 7, 6

Value = dict[str, Any]
# The keys that say where a frame lies; see `FramePlaces`.
Place = Callable[[str], Value]


class UnknownFrame(Exception):
    """No chain of transforms leads from this frame to the map."""

    def __init__(self, frame: str) -> None:
        super().__init__(f"frame '{frame[:60]}' is not known: no transform leads to the map")


class ShownMessage(NamedTuple):
    """A message for the page, its omissions, and its faults, in words."""

    value: Value
    left_out: str = ""
    problem: str = ""


def to_plain(value: Any) -> Any:
    """Turn a message into what JSON can hold; bytes become base64, NaN and infinity null."""
    if hasattr(value, "__msgtype__"):
        fields = value.__dataclass_fields__
        return {name: to_plain(getattr(value, name)) for name in fields if name != "__msgtype__"}
    if isinstance(value, np.ndarray):
        return to_base64(value) if value.dtype == np.uint8 else to_plain(value.tolist())
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def to_base64(data: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(data).tobytes()).decode()


def show_header(header: Any, place: Place) -> Value:
    """Make a header that says where its frame lies.

    Raises: UnknownFrame: where it lies is unknown.
    """
    stamp = {"sec": int(header.stamp.sec), "nanosec": int(header.stamp.nanosec)}
    return {"frame_id": header.frame_id, "stamp": stamp, **place(header.frame_id)}


def show_message(message: Any, place: Place) -> ShownMessage:
    """Convert a message that stands for itself; `shown_sets` has those that add up.

    Raises: UnknownFrame: its frame is not known. BridgeError: no display reads its type.
    """
    ros_type = message.__msgtype__
    if ros_type not in _SHOWERS:
        raise BridgeError(f"no display reads {ros_type}; choose another topic")
    return _SHOWERS[ros_type](message, place)


def _show_whole(message: Any, place: Place) -> ShownMessage:
    value = to_plain(message)
    if hasattr(message, "header"):
        value["header"] = show_header(message.header, place)
    return ShownMessage(value)


def _show_free(message: Any, _place: Place) -> ShownMessage:
    """Show what lies nowhere, such as a number, or in longitude and latitude."""
    return ShownMessage(to_plain(message))


def _show_fix(message: Any, _place: Place) -> ShownMessage:
    """Show a fix with its receiver's state left out; unknown numbers are left out as well."""
    value = to_plain(message)
    known = {name: each for name, each in value.items() if each is not None and name != "status"}
    if "latitude" not in known or "longitude" not in known:
        return ShownMessage({}, problem="a fix without a place")
    return ShownMessage(known)


def _show_text(message: Any, _place: Place) -> ShownMessage:
    text = str(message.data if hasattr(message, "data") else message.value)
    note = f"{len(text)} letters cut to {MOST_TEXT}" if len(text) > MOST_TEXT else ""
    return ShownMessage({"data": text[:MOST_TEXT]}, note)


def _show_number(message: Any, _place: Place) -> ShownMessage:
    for name in ("data", "value", "velocity"):
        if hasattr(message, name):
            return ShownMessage({"data": to_plain(float(getattr(message, name)))})
    return ShownMessage({})


def _show_point(message: Any, place: Place) -> ShownMessage:
    pose = {"position": to_plain(message.point)}
    return ShownMessage({"header": show_header(message.header, place), "pose": pose})


def _show_odometry_pose(message: Any, place: Place) -> ShownMessage:
    return ShownMessage(
        {"header": show_header(message.header, place), "pose": to_plain(message.pose)},
    )


def _show_path(message: Any, place: Place) -> ShownMessage:
    poses, note = _thin(message.poses, "places")
    points = [{"pose": {"position": to_plain(each.pose.position)}} for each in poses]
    return ShownMessage({"header": show_header(message.header, place), "poses": points}, note)


def _show_polygon(message: Any, place: Place) -> ShownMessage:
    corners, note = _thin(message.polygon.points, "corners")
    closed = [*corners, *corners[:1]]
    points = [{"pose": {"position": to_plain(each)}} for each in closed]
    return ShownMessage({"header": show_header(message.header, place), "poses": points}, note)


def _show_route(message: Any, place: Place) -> ShownMessage:
    kept, note = _thin(message.route_points, "places")
    points = [{"pose": {"position": to_plain(each.pose.position)}} for each in kept]
    return ShownMessage(
        {"header": show_header(message.header, place), "route_points": points}, note
    )


def _thin(items: Any, what: str) -> tuple[list[Any], str]:
    """Take every so-manieth item and the last one."""
    step = math.ceil(len(items) / MOST_POINTS)
    if step <= 1:
        return list(items), ""
    kept = [*items[: len(items) - 1 : step], items[-1]]
    return kept, f"{len(items):,} {what} thinned to {len(kept):,}"


def _show_scan(message: Any, place: Place) -> ShownMessage:
    ranges = np.asarray(message.ranges, dtype=float)
    intensities = np.asarray(message.intensities, dtype=float)
    step = max(1, math.ceil(len(ranges) / MOST_BEAMS))
    kept = ranges[::step]
    value = {
        "header": show_header(message.header, place),
        "angle_min": to_plain(float(message.angle_min)),
        "angle_increment": to_plain(float(message.angle_increment) * step),
        "range_min": to_plain(float(message.range_min)),
        "range_max": to_plain(float(message.range_max)),
        "ranges": to_plain(np.round(kept, 4)),
    }
    if len(intensities) == len(ranges):
        value["intensities"] = to_plain(np.round(intensities[::step], 3))
    note = f"{len(ranges):,} beams thinned to {len(kept):,}" if step > 1 else ""
    return ShownMessage(value, note)


def _show_cloud(message: Any, place: Place) -> ShownMessage:
    """Show a cloud of 32-bit numbers: x, y, z, and the first few other fields."""
    header = show_header(message.header, place)
    count = int(message.width) * int(message.height)
    # First roughly, to drop the points without a place, then exactly.
    points, names = read_cloud(message, every=max(1, count // (_SPARE * MOST_CLOUD_POINTS)))
    is_finite = np.isfinite(points[:, 0] + points[:, 1]) if len(points) else np.zeros(0, bool)
    finite = points[is_finite]
    step = max(1, math.ceil(len(finite) / MOST_CLOUD_POINTS))
    kept = np.ascontiguousarray(finite[::step], dtype="<f4")
    fields = [
        {"name": name, "offset": 4 * at, "datatype": _UINT32 if name in _PACKED else _FLOAT32}
        for at, name in enumerate(names)
    ]
    value = {
        "header": header, "fields": fields, "is_bigendian": False, "point_step": 4 * len(names),
        "width": len(kept), "height": 1, "data": to_base64(kept),
    }  # fmt: skip
    note = f"{count:,} points thinned to {len(kept):,}" if step > 1 else ""
    return ShownMessage(value, note)


_SPARE = 5  # factor of searched points over shown ones
_PACKED = ("rgb", "rgba")


def read_cloud(message: Any, every: int = 1) -> tuple[FloatArray, tuple[str, ...]]:
    """Read every so-manieth point (n, fields) of a PointCloud2 as 32-bit numbers, and the names.

    Colours keep their bits. A cloud without x and y, or shorter than it says, has no points.
    """
    order = ">" if message.is_bigendian else "<"
    fields = {f.name: f for f in message.fields if f.datatype in _KINDS}
    if not {"x", "y"} <= set(fields):
        return np.zeros((0, 3), dtype="<f4"), ("x", "y", "z")
    others = [name for name in fields if name not in ("x", "y", "z")][:_MOST_FIELDS]
    names = [*(name for name in ("x", "y", "z") if name in fields), *others]
    step = int(message.point_step)
    data = np.asarray(message.data, dtype=np.uint8)
    count = min(int(message.width) * int(message.height), len(data) // step if step else 0)
    ends = (int(f.offset) + np.dtype(_KINDS[f.datatype]).itemsize for f in fields.values())
    if count == 0 or max(ends) > step:
        return np.zeros((0, len(names)), dtype="<f4"), tuple(names)
    kinds = ["<u4" if name in _PACKED else order + _KINDS[fields[name].datatype] for name in names]
    layout = np.dtype(
        {
            "names": names,
            "formats": kinds,
            "offsets": [int(fields[name].offset) for name in names],
            "itemsize": step,
        }
    )
    whole = np.ascontiguousarray(data[: count * step].reshape(count, step)[::every])
    rows = whole.reshape(-1).view(layout)
    columns = [
        rows[name].view("<f4") if name in _PACKED else rows[name].astype("<f4") for name in names
    ]
    return np.stack(columns, axis=1), tuple(names)


class FramePlaces:
    """Places of frames: in the map by transforms, or on the robot.

    `find` gives the transform (4, 4) from the second frame to the first; `body_frames` are the
    robot's own, each with its place on the robot. A key `in_map` or `in_body` holds the matrix,
    row by row; the map itself has none.
    """

    def __init__(
        self,
        find: Callable[[str, str], FloatArray | None],
        body_frames: dict[str, FloatArray],
    ) -> None:
        self._find, self._body_frames = find, body_frames

    def __call__(self, frame: str) -> Value:
        """Look a frame up.

        Raises: UnknownFrame: no chain leads to the map or to the robot.
        """
        name = clean_name(frame)
        if name in ("", "map"):
            return {}
        in_map = self._find("map", name)
        if in_map is not None:
            return {"in_map": in_map.ravel().tolist()}
        if name in self._body_frames:
            return {"in_body": self._body_frames[name].ravel().tolist()}
        for own, body_from_own in self._body_frames.items():
            in_own = self._find(own, name)
            if in_own is not None:
                return {"in_body": (body_from_own @ in_own).ravel().tolist()}
        raise UnknownFrame(frame)


def _show_picture(make: Callable[[Any], tuple[Value, str]]) -> Callable[[Any, Place], ShownMessage]:
    """Show what is painted beside the map, whatever the place of its camera."""
    return lambda message, _place: ShownMessage(*make(message))


_SHOWERS: dict[str, Callable[[Any, Place], ShownMessage]] = {
    "gps_common/msg/GPSFix": _show_fix,
    "gps_msgs/msg/GPSFix": _show_fix,
    "sensor_msgs/msg/NavSatFix": _show_fix,
    "nav_msgs/msg/Odometry": _show_whole,
    "geometry_msgs/msg/PoseStamped": _show_whole,
    "geometry_msgs/msg/PoseWithCovarianceStamped": _show_odometry_pose,
    "geometry_msgs/msg/PointStamped": _show_point,
    "geometry_msgs/msg/PolygonStamped": _show_polygon,
    "geometry_msgs/msg/TransformStamped": _show_whole,
    "sensor_msgs/msg/Imu": _show_free,
    "nav_msgs/msg/Path": _show_path,
    "marti_nav_msgs/msg/Route": _show_route,
    "sensor_msgs/msg/LaserScan": _show_scan,
    "sensor_msgs/msg/PointCloud2": _show_cloud,
    "stereo_msgs/msg/DisparityImage": _show_picture(show_disparity),
    "sensor_msgs/msg/Image": _show_picture(show_image),
    "sensor_msgs/msg/CompressedImage": _show_picture(show_compressed),
    "std_msgs/msg/String": _show_text,
    "marti_common_msgs/msg/StringStamped": _show_text,
    **{ros_type: _show_number for ros_type, shown in SHOWN_TYPES.items() if shown == ("float",)},
}
