"""ROS 1 messages: definitions, md5 sums and bytes, from our CDR messages."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.topics import Topic
from agribot.ros.decoding import make_undecodable
from agribot.ros.messages.gps_types import (
    GPSFIX_ROS1,
    GPSFIX_ROS2,
    IN_ROS1,
    read_shipped_texts,
    register_gps_types,
    use_ros1_codes,
)
from agribot.ros.messages.rosmsg import MAP_FRAME, make_header, make_message, to_cdr
from agribot.ros.messages.rosmsg import load_types as ros2_types
from agribot.ros.requests import Twist

Convert = Callable[[bytes], bytes]

# Names under which the original published by mistake, beside the intended ones.
_ACCIDENTAL = {
    topics.IMAGE_RAW.name: "/agribot/agribot/camera/image_raw",
    topics.CAMERA_INFO.name: "/agribot/agribot/camera/camera_info",
}


# Names and types of further publications, by the name of their topic.
_FURTHER = {topics.DRAWN_ROUTE.name: {"/route": "marti_nav_msgs/msg/Route"}}


class OutputTopic(NamedTuple):
    """A ROS 1 topic that is published for a topic of the table."""

    name: str
    ros_type: str  # as in the table, package/msg/Name
    convert: Convert
    latched: bool
    depth: int


@functools.cache
def load_ros1_types() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    text = "geometry_msgs/TransformStamped[] transforms\n"  # tf2_msgs is missing in the library
    store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
    register_gps_types(store, IN_ROS1)
    for name, shipped in read_shipped_texts().items():
        if name.startswith("marti_"):
            store.register(get_types_from_msg(shipped, name))
    return store


def add_ros1_types(texts: Mapping[str, str]) -> Typestore:
    """Add types by their names; return all of ROS 1."""
    store = load_ros1_types()
    for name, text in texts.items():
        store.register(get_types_from_msg(text, name))
    return store


def to_ros1_name(ros_type: str) -> str:
    return ros_type.replace("/msg/", "/")


def generate_definition(ros_type: str, types: Typestore | None = None) -> tuple[str, str]:
    """Generate message definition and md5 sum."""
    text, md5 = (types or load_ros1_types()).generate_msgdef(ros_type, ros_version=1)
    return text, md5


def list_outputs(topic: Topic) -> list[OutputTopic]:
    """List the ROS 1 topics of a topic: our names and type, then those of the original."""
    ros_type = topic.ros_type
    if ros_type == GPSFIX_ROS2:  # its package has another name in ROS 1
        ros_type = GPSFIX_ROS1
    found = dict.fromkeys(topic.names, ros_type)
    if topic.seed_alias:
        found.setdefault(topic.seed_alias, topic.seed_ros_type)
    found.update(_FURTHER.get(topic.name, {}))
    if topic.name in _ACCIDENTAL:
        found[_ACCIDENTAL[topic.name]] = topic.ros_type
    one_second = max(topic.qos.depth, round(topic.rate_hz or 0.0))  # a busy machine stalls
    depth = 2 if topic.struct is topics.IMAGE.struct else one_second
    return [
        OutputTopic(
            name, ros_type, _make_converter(topic.ros_type, ros_type), topic.qos.latched, depth
        )
        for name, ros_type in found.items()
    ]


def _make_converter(from_type: str, to_type: str) -> Convert:
    if from_type == GPSFIX_ROS2:
        return lambda data: bytes(
            ros2_types().cdr_to_ros1(to_cdr(use_ros1_codes(_decode(data, from_type))), from_type)
        )
    if (from_type, to_type) in _CHANGES:
        change = _CHANGES[from_type, to_type]
        return lambda data: _encode_ros1(change(_decode(data, from_type)), to_type)
    assert from_type == to_type, (from_type, to_type)
    if from_type == topics.WEEDS.ros_type:  # Marker has grown since ROS 1
        return lambda data: _encode_ros1(_to_ros1_markers(_decode(data, from_type)), to_type)
    return lambda data: bytes(ros2_types().cdr_to_ros1(data, from_type))


class InputTopic(NamedTuple):
    """The ROS 1 topic that a node subscribes to for a topic of the table."""

    name: str
    ros_type: str
    convert: Convert  # to CDR; raises BridgeError


def find_input(topic: Topic) -> InputTopic:
    """Find the ROS 1 topic to subscribe to: the original's name and type where there is one."""
    name, ros_type = topic.name, topic.ros_type
    if topic.seed_alias:
        name, ros_type = topic.seed_alias, topic.seed_ros_type or ros_type
    change = _BACK.get((ros_type, topic.ros_type))
    known_type = GPSFIX_ROS2 if ros_type == GPSFIX_ROS1 else ros_type  # to the types of ROS 2
    if change is None and known_type != topic.ros_type:
        raise BridgeError(f"{ros_type} is not {topic.ros_type}; send that type")

    def convert(data: bytes) -> bytes:
        try:
            cdr = bytes(ros2_types().ros1_to_cdr(data, known_type))
            return cdr if change is None else to_cdr(change(_decode(cdr, ros_type)))
        except Exception as error:  # the generated code of rosbags raises any error
            raise make_undecodable(data, to_ros1_name(ros_type)) from error

    return InputTopic(name, ros_type, convert)


def _to_field(message: Any) -> Any:
    """Convert the original's vector, which has no unit but the same direction, to a field."""
    return make_message(topics.MAGNETIC.ros_type, message.header, message.vector, np.zeros(9))


def _add_stamp(message: Any) -> Any:
    return make_message(topics.POSE.ros_type, make_header(0.0, MAP_FRAME), message)


_BACK: dict[tuple[str, str], Callable[[Any], Any]] = {
    (topics.MAGNETIC.seed_ros_type, topics.MAGNETIC.ros_type): _to_field,
    (topics.POSE.seed_ros_type, topics.POSE.ros_type): _add_stamp,
}


def _decode(data: bytes, ros_type: str) -> Any:
    return ros2_types().deserialize_cdr(data, ros_type)


def _encode_ros1(message: Any, ros_type: str) -> bytes:
    return bytes(load_ros1_types().serialize_ros1(message, ros_type))


def _to_ros1_header(head: Any) -> Any:
    types = load_ros1_types().types
    time = types["builtin_interfaces/msg/Time"](head.stamp.sec, head.stamp.nanosec)
    return types["std_msgs/msg/Header"](0, time, head.frame_id)


def _to_vector(message: Any) -> Any:
    make = load_ros1_types().types["geometry_msgs/msg/Vector3Stamped"]
    return make(_to_ros1_header(message.header), message.magnetic_field)


def _to_ros1_markers(message: Any) -> Any:
    types = load_ros1_types().types
    make = types["visualization_msgs/msg/Marker"]
    duration = types["builtin_interfaces/msg/Duration"](0, 0)
    return types["visualization_msgs/msg/MarkerArray"](
        [
            make(
                _to_ros1_header(m.header), m.ns, m.id, m.type, m.action, m.pose, m.scale, m.color,
                duration, m.frame_locked, m.points, m.colors, m.text, m.mesh_resource,
                m.mesh_use_embedded_materials,
            )
            for m in message.markers
        ]
    )  # fmt: skip


def _to_marti_route(message: Any) -> Any:
    types = load_ros1_types().types
    make_point = types["marti_nav_msgs/msg/RoutePoint"]
    points = [make_point(each.pose, str(i), []) for i, each in enumerate(message.poses)]
    return types["marti_nav_msgs/msg/Route"](_to_ros1_header(message.header), points, [])


_CHANGES: dict[tuple[str, str], Callable[[Any], Any]] = {
    (topics.MAGNETIC.ros_type, topics.MAGNETIC.seed_ros_type): _to_vector,
    (topics.DRAWN_ROUTE.ros_type, "marti_nav_msgs/msg/Route"): _to_marti_route,
    (topics.POSE.ros_type, topics.POSE.seed_ros_type): lambda message: message.pose,
}

_TWIST = struct.Struct("<6d")


def read_twist(data: bytes) -> Twist | None:
    """Read a geometry_msgs/Twist; None if the bytes are not one."""
    if len(data) != _TWIST.size:
        return None
    a, b, c, d, e, f = _TWIST.unpack(data)
    return (a, b, c, d, e, f)
