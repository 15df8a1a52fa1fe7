"""Message types of both ROS versions, and the same message from one to the other.

The maintained type libraries of rosbags hold what ROS itself ships. Here come on top the types
of gps_umd and marti_messages that the tools of the original AGRIBOT use, as .msg texts of our
own in `ros/messages/msg`; their md5 sums are those of the originals.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from rosbags.convert.converter import is_same_wireformat, migrate_message
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agribot.ros.messages.gps_types import IN_ROS1 as _ROS1_PACKAGE
from agribot.ros.messages.gps_types import IN_ROS2 as _ROS2_PACKAGE
from agribot.ros.messages.gps_types import read_shipped_texts

Transcoder = Callable[[bytes], bytes]

_IN_ROS2_STORES = {"tf2_msgs"}


def make_ros1_store() -> Typestore:
    """Make a store of ROS 1 Noetic and the shipped types, which may learn further types."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types: dict[str, Any] = {}
    for name, text in read_shipped_texts().items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


def make_ros2_store() -> Typestore:
    """Make a store of ROS 2 Jazzy and the shipped types, which may learn further types."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, text in read_shipped_texts().items():
        if name.partition("/")[0] not in _IN_ROS2_STORES:
            types.update(get_types_from_msg(text, name_in_ros2(name)))
    store.register(types)
    return store


@functools.cache
def ros1_store() -> Typestore:
    """Return the shared store of ROS 1 types: for reading only."""
    return make_ros1_store()


@functools.cache
def ros2_store() -> Typestore:
    """Return the shared store of ROS 2 types: for reading only."""
    return make_ros2_store()


def name_in_ros2(ros_type: str) -> str:
    package, _, rest = ros_type.partition("/")
    if ros_type == "tf/msg/tfMessage":
        return "tf2_msgs/msg/TFMessage"
    return f"{_ROS2_PACKAGE}/{rest}" if package == _ROS1_PACKAGE else ros_type


def name_in_ros1(ros_type: str) -> str:
    package, _, rest = ros_type.partition("/")
    return f"{_ROS1_PACKAGE}/{rest}" if package == _ROS2_PACKAGE else ros_type


def make_transcoder(
    source: Typestore,
    source_type: str,
    from_ros2: bool,
    target: Typestore,
    target_type: str,
    to_ros2: bool,
) -> Transcoder:
    """Make a function from bytes of one type definition to bytes of another.

    Where the two definitions differ, fields go by name; one that only the target has is zero.
    """
    if is_same_wireformat(source, target, source_type, target_type):
        if from_ros2 == to_ros2:
            return bytes
        if from_ros2:
            return lambda data: bytes(
                source.cdr_to_ros1(_make_little_endian(source, source_type, data), source_type)
            )
        return lambda data: bytes(target.ros1_to_cdr(data, target_type))
    cache: dict[str, object] = {}

    def migrate(data: bytes) -> bytes:
        message = deserialize(source, source_type, from_ros2, data)
        moved = migrate_message(source, target, source_type, target_type, cache, message)
        return serialize(target, target_type, to_ros2, moved)

    return migrate


def _make_little_endian(store: Typestore, ros_type: str, data: bytes) -> bytes:
    """Turn a message around that a big-endian computer wrote; others stay as they are."""
    if data[1:2] != b"\0":
        return data
    return serialize(store, ros_type, True, deserialize(store, ros_type, True, data))


def deserialize(store: Typestore, ros_type: str, is_ros2: bool, data: bytes) -> Any:
    if is_ros2:
        return store.deserialize_cdr(data, ros_type)
    return store.deserialize_ros1(data, ros_type)


def serialize(store: Typestore, ros_type: str, is_ros2: bool, message: Any) -> bytes:
    if is_ros2:
        return bytes(store.serialize_cdr(message, ros_type))
    return bytes(store.serialize_ros1(message, ros_type))


def collect_definitions(defined: Any, *ros_types: str) -> dict[str, Any]:
    """Collect the definitions of types and of all types inside them, of those that are defined."""
    found: dict[str, Any] = {}
    waiting = list(ros_types)
    while waiting:
        name = waiting.pop()
        if name in defined and name not in found:
            found[name] = defined[name]
            waiting += list_inner_types(defined, name)
    return found


def list_inner_types(defined: Any, ros_type: str) -> list[str]:
    """List the message types that the fields of a type have."""
    names = []
    for _, description in defined[ros_type][1]:
        kind = description
        while kind[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            kind = kind[1][0]
        if kind[0] == Nodetype.NAME:
            names.append(kind[1])
    return names
