"""ROS 1 messages: definitions, md5 sums and bytes, from our CDR messages."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.topics import Topic
from agribot.ros.messages.rosmsg import MAP_FRAME, header, make, to_cdr
from agribot.ros.messages.rosmsg import typestore as ros2_types
from agribot.ros.requests import Twist

Convert = Callable[[bytes], bytes]

# Names under which the original really published, beside those it meant.
_ACCIDENTAL = {
    topics.IMAGE_RAW.name: "/agribot/agribot/camera/image_raw",
    topics.CAMERA_INFO.name: "/agribot/agribot/camera/camera_info",
    topics.ODOMETRY.name: "/odom",
}


class Output(NamedTuple):
    """One ROS 1 topic that a topic of the table feeds."""

    name: str
    ros_type: str  # as in the table, package/msg/Name
    convert: Convert
    latched: bool
    depth: int


@functools.cache
def ros1_types() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    text = "geometry_msgs/TransformStamped[] transforms\n"  # tf2_msgs is missing in the library
    store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
    return store


def ros1_name(ros_type: str) -> str:
    return ros_type.replace("/msg/", "/")


def definition(ros_type: str) -> tuple[str, str]:
    """Message definition and md5 sum."""
    text, md5 = ros1_types().generate_msgdef(ros_type, ros_version=1)
    return text, md5


def outputs(topic: Topic) -> list[Output]:
    """Our own name with our type, then the original's name with the original's type."""
    found = {topic.name: topic.ros_type}
    if topic.seed_alias:
        found.setdefault(topic.seed_alias, topic.seed_ros_type)
    if topic.name in _ACCIDENTAL:
        found[_ACCIDENTAL[topic.name]] = topic.ros_type
    one_second = max(topic.qos.depth, round(topic.rate_hz or 0.0))  # a busy machine stalls
    depth = 2 if topic.struct is topics.IMAGE.struct else one_second
    return [
        Output(name, ros_type, _converter(topic.ros_type, ros_type), topic.qos.latched, depth)
        for name, ros_type in found.items()
    ]


def _converter(from_type: str, to_type: str) -> Convert:
    if (from_type, to_type) in _CHANGES:
        change = _CHANGES[from_type, to_type]
        return lambda data: _ros1_bytes(change(_decoded(data, from_type)), to_type)
    assert from_type == to_type, (from_type, to_type)
    if from_type == topics.WEEDS.ros_type:  # Marker has grown since ROS 1
        return lambda data: _ros1_bytes(_markers(_decoded(data, from_type)), to_type)
    return lambda data: bytes(ros2_types().cdr_to_ros1(data, from_type))


class Inlet(NamedTuple):
    """The ROS 1 topic that stands for a topic of the table when a node listens."""

    name: str
    ros_type: str
    convert: Convert  # to CDR; raises BridgeError


def inlet(topic: Topic) -> Inlet:
    """The original's name and type where there is one."""
    name, ros_type = topic.name, topic.ros_type
    if topic.seed_alias:
        name, ros_type = topic.seed_alias, topic.seed_ros_type or ros_type
    change = _BACK.get((ros_type, topic.ros_type))
    if change is None and ros_type != topic.ros_type:
        raise BridgeError(f"nothing turns {ros_type} into {topic.ros_type}")

    def convert(data: bytes) -> bytes:
        try:
            cdr = bytes(ros2_types().ros1_to_cdr(data, ros_type))
            return cdr if change is None else to_cdr(change(_decoded(cdr, ros_type)))
        except Exception as error:  # rosbags raises what its generated code happens to raise
            raise BridgeError(f"{len(data)} bytes are no {ros1_name(ros_type)}") from error

    return Inlet(name, ros_type, convert)


def _field_of_vector(message: Any) -> Any:
    """The original's magnetometer had no tesla, but the same direction."""
    return make(topics.MAGNETIC.ros_type, message.header, message.vector, np.zeros(9))


def _stamped(message: Any) -> Any:
    return make(topics.POSE.ros_type, header(0.0, MAP_FRAME), message)


_BACK: dict[tuple[str, str], Callable[[Any], Any]] = {
    (topics.MAGNETIC.seed_ros_type, topics.MAGNETIC.ros_type): _field_of_vector,
    (topics.POSE.seed_ros_type, topics.POSE.ros_type): _stamped,
}


def _decoded(data: bytes, ros_type: str) -> Any:
    return ros2_types().deserialize_cdr(data, ros_type)


def _ros1_bytes(message: Any, ros_type: str) -> bytes:
    return bytes(ros1_types().serialize_ros1(message, ros_type))


def _header(head: Any) -> Any:
    types = ros1_types().types
    time = types["builtin_interfaces/msg/Time"](head.stamp.sec, head.stamp.nanosec)
    return types["std_msgs/msg/Header"](0, time, head.frame_id)


def _vector_of_field(message: Any) -> Any:
    make = ros1_types().types["geometry_msgs/msg/Vector3Stamped"]
    return make(_header(message.header), message.magnetic_field)


def _markers(message: Any) -> Any:
    types = ros1_types().types
    make = types["visualization_msgs/msg/Marker"]
    duration = types["builtin_interfaces/msg/Duration"](0, 0)
    return types["visualization_msgs/msg/MarkerArray"](
        [
            make(
                _header(m.header), m.ns, m.id, m.type, m.action, m.pose, m.scale, m.color, duration,
                m.frame_locked, m.points, m.colors, m.text, m.mesh_resource,
                m.mesh_use_embedded_materials,
            )
            for m in message.markers
        ]
    )  # fmt: skip


_CHANGES: dict[tuple[str, str], Callable[[Any], Any]] = {
    (topics.MAGNETIC.ros_type, topics.MAGNETIC.seed_ros_type): _vector_of_field,
    (topics.POSE.ros_type, topics.POSE.seed_ros_type): lambda message: message.pose,
}

_TWIST = struct.Struct("<6d")


def read_twist(data: bytes) -> Twist | None:
    """None where these bytes are no geometry_msgs/Twist."""
    if len(data) != _TWIST.size:
        return None
    a, b, c, d, e, f = _TWIST.unpack(data)
    return (a, b, c, d, e, f)
