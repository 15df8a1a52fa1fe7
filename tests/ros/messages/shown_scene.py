"""One message for each display of the map, each at a place of its own."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from agribot.record.bag.definitions import (
    make_transcoder,
    name_in_ros1,
    ros1_store,
    ros2_store,
    serialize,
)
from tests.ros.messages import shown_samples as samples

LASER = (2.0, 6.0)  # of the frame `laser` in the map, m


class Said(NamedTuple):
    topic: str
    display: str
    message: Any
    rate_hz: float  # 0: once, latched


def make_scene() -> list[Said]:
    """A scan and a cloud lie in the frame `laser`, all else in the map."""
    return [
        Said("/tf_static", "", make_transforms(), 0.0),
        Said("/scan", "laserscan", make_scan(), 10.0),
        Said("/cloud", "pointcloud2", make_cloud(), 1.0),
        Said("/map", "occupancy_grid", make_grid(), 0.0),
        Said("/markers", "marker", make_markers(), 2.0),
        Said("/picture", "textured_marker", make_texture(), 0.0),
        Said("/stereo/disparity", "disparity", make_disparity(), 2.0),
    ]


def make_transforms() -> Any:
    transform = samples.make(
        "geometry_msgs/msg/Transform", samples.vector(*LASER, 0.5),
        samples.quaternion(0.0, 0.0, 0.0, 1.0),
    )  # fmt: skip
    stamped = samples.make(
        "geometry_msgs/msg/TransformStamped", samples.header("map"), "laser", transform
    )
    return samples.make("tf2_msgs/msg/TFMessage", [stamped])


def make_scan() -> Any:
    """A wall in the shape of an arc, 3 m around the laser."""
    message = samples.scan([3.0] * 181, frame="laser", step=math.pi / 180.0)
    message.angle_min, message.angle_max = -math.pi / 2.0, math.pi / 2.0
    return message


def make_cloud() -> Any:
    """A million points on a slope, 4 m square, behind the laser."""
    side = np.linspace(0.0, 4.0, 1000)
    x, y = np.meshgrid(-6.0 + side, side - 2.0)
    points = np.stack([x.ravel(), y.ravel(), x.ravel() + 6.0, np.zeros(x.size)], axis=1)
    return samples.cloud(points, frame="laser")


def make_grid() -> Any:
    cells = np.zeros((20, 30), dtype=np.int8)
    cells[0, :] = cells[-1, :] = cells[:, 0] = cells[:, -1] = 100
    cells[5:9, 5:9] = 100
    cells[12:, 20:29] = -1
    grid = samples.grid(cells, resolution=0.2)
    grid.info.origin = samples.pose(8.0, -6.0)
    return grid


def make_markers() -> Any:
    cube = samples.marker(1, at=(2.0, -2.0))
    arrow = samples.marker(2, kind=0, at=(4.0, -2.0))
    text = samples.marker(3, kind=9, at=(6.0, -2.0))
    text.text = "stone"
    lost = samples.marker(4, frame="moon")
    return samples.make("visualization_msgs/msg/MarkerArray", [cube, arrow, text, lost])


def make_texture() -> Any:
    y, x = np.mgrid[0:64, 0:64]
    pixels = np.zeros((64, 64, 3), dtype=np.uint8)
    pixels[(x // 8 + y // 8) % 2 == 0] = (40, 90, 200)
    pixels[(x // 8 + y // 8) % 2 == 1] = (240, 220, 90)
    first = samples.texture(pixels, resolution=0.05)
    first.pose = samples.pose(2.0, -6.0)
    second = samples.texture(pixels, resolution=0.03)
    second.id, second.pose = 1, samples.pose(4.8, -6.0)
    second.pose.orientation = samples.quaternion(0.0, 0.0, math.sin(0.4), math.cos(0.4))
    return samples.make("marti_visualization_msgs/msg/TexturedMarkerArray", [first, second])


def make_disparity() -> Any:
    y, x = np.mgrid[0:120, 0:160]
    return samples.disparity((100.0 * x / 160.0 * (y > 30)).astype("<f4"))


def to_ros1(message: Any) -> bytes:
    """Turn a message of ROS 2 into the bytes of ROS 1; what only ROS 1 has is zero."""
    ros_type = message.__msgtype__
    target_type = name_in_ros1(ros_type)
    convert = make_transcoder(ros2_store(), ros_type, True, ros1_store(), target_type, False)
    return convert(serialize(ros2_store(), ros_type, True, message))
