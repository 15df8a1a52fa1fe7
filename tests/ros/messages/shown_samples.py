"""Messages of the types that displays show, as ROS 2 objects."""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from agribot.record.bag.definitions import ros2_store

_KINDS = {"f4": 7, "f8": 8}


def make(ros_type: str, *values: Any) -> Any:
    return ros2_store().types[ros_type](*values)


def header(frame: str = "map") -> Any:
    return make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", 5, 0), frame)


def vector(x: float, y: float, z: float = 0.0) -> Any:
    return make("geometry_msgs/msg/Vector3", x, y, z)


def point(x: float, y: float, z: float = 0.0) -> Any:
    return make("geometry_msgs/msg/Point", x, y, z)


def quaternion(x: float, y: float, z: float, w: float) -> Any:
    return make("geometry_msgs/msg/Quaternion", x, y, z, w)


def pose(x: float = 0.0, y: float = 0.0) -> Any:
    return make("geometry_msgs/msg/Pose", point(x, y), quaternion(0.0, 0.0, 0.0, 1.0))


def scan(ranges: list[float], frame: str = "map", step: float = 0.5) -> Any:
    values = np.array(ranges, dtype=np.float32)
    none = np.zeros(0, dtype=np.float32)
    return make("sensor_msgs/msg/LaserScan", header(frame), -1.0, 1.0, step, 0.0, 0.1, 0.1, 30.0,
                values, none)  # fmt: skip


def cloud(
    points: Any, frame: str = "map", kind: str = "<f4", padding: int = 0, last: str = "intensity"
) -> Any:
    """Points (n, 4): x, y, z and one more."""
    size = np.dtype(kind).itemsize
    names = ("x", "y", "z", last)
    fields = [
        make("sensor_msgs/msg/PointField", name, i * size, _KINDS[kind[1:]], 1)
        for i, name in enumerate(names)
    ]
    rows = np.ascontiguousarray(points, dtype=kind).view(np.uint8).reshape(len(points), -1)
    data = np.pad(rows, ((0, 0), (0, padding))).ravel()
    return make("sensor_msgs/msg/PointCloud2", header(frame), 1, len(points), fields,
                kind[0] == ">", 4 * size + padding, len(data), data, True)  # fmt: skip


def marker(
    id: int, frame: str = "map", kind: int = 1, action: int = 0, lifetime_s: float = 0.0,
    at: tuple[float, float] = (0.0, 0.0),
) -> Any:  # fmt: skip
    store = ros2_store()
    made = make_default(store, "visualization_msgs/msg/Marker")
    made.header, made.ns, made.id, made.type, made.action = header(frame), "test", id, kind, action
    made.pose, made.scale = pose(*at), vector(1.0, 1.0, 1.0)
    made.color = make("std_msgs/msg/ColorRGBA", 1.0, 0.2, 0.0, 1.0)
    made.lifetime = make("builtin_interfaces/msg/Duration", int(lifetime_s), 0)
    return made


def grid(cells: Any, resolution: float = 0.5, frame: str = "map") -> Any:
    height, width = cells.shape
    info = make("nav_msgs/msg/MapMetaData", make("builtin_interfaces/msg/Time", 0, 0), resolution,
                width, height, pose())  # fmt: skip
    return make("nav_msgs/msg/OccupancyGrid", header(frame), info, cells.ravel())


def grid_update(x: int, y: int, cells: Any) -> Any:
    height, width = cells.shape
    return make("map_msgs/msg/OccupancyGridUpdate", header(), x, y, width, height, cells.ravel())


def image(pixels: Any, encoding: str = "rgb8") -> Any:
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
    return make("sensor_msgs/msg/Image", header("camera"), height, width, encoding, 0,
                len(data) // height, data)  # fmt: skip


def disparity(pixels: Any) -> Any:
    window = make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
    return make("stereo_msgs/msg/DisparityImage", header("camera"), image(pixels, "32FC1"), 500.0,
                0.1, window, 0.0, 100.0, 0.1)  # fmt: skip


def texture(pixels: Any, resolution: float, frame: str = "map") -> Any:
    made = make_default(ros2_store(), "marti_visualization_msgs/msg/TexturedMarker")
    made.header, made.ns, made.image, made.pose = header(frame), "t", image(pixels), pose()
    made.resolution, made.alpha = resolution, 1.0
    return made


def make_default(store: Typestore, ros_type: str) -> Any:
    """A message of zeros, with a pixel in its pictures."""
    if ros_type == "sensor_msgs/msg/Image":
        values: dict[str, Any] = {"height": 1, "width": 1, "encoding": "mono8", "is_bigendian": 0,
                                  "step": 1}  # fmt: skip
        head = make_default(store, "std_msgs/msg/Header")
        return store.types[ros_type](header=head, **values, data=np.zeros(1, np.uint8))
    if ros_type == "sensor_msgs/msg/CompressedImage":
        head = make_default(store, "std_msgs/msg/Header")
        return store.types[ros_type](header=head, format="png", data=np.zeros(4, np.uint8))
    made = {name: _zero(store, kind) for name, kind in store.fielddefs[ros_type][1]}
    if ros_type == "stereo_msgs/msg/DisparityImage":
        made["image"].encoding, made["image"].step = "32FC1", 4
        made["image"].data = np.zeros(4, np.uint8)
    return store.types[ros_type](**made)


_ARRAYS = {"bool": np.bool_, "octet": np.uint8, "byte": np.int8, "char": np.uint8}


def _zero(store: Typestore, kind: Any) -> Any:
    what, inner = kind
    if what == Nodetype.NAME:
        return make_default(store, inner)
    if what == Nodetype.BASE:
        return {"string": "", "bool": False}.get(inner[0], 0.0 if "float" in inner[0] else 0)
    (element, count) = inner
    if element[0] == Nodetype.NAME or element[1][0] == "string":
        return [_zero(store, element) for _ in range(count if what == Nodetype.ARRAY else 0)]
    base = element[1][0]
    length = count if what == Nodetype.ARRAY else 0
    return np.zeros(length, dtype=_ARRAYS.get(base, base))
