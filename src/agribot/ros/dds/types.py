"""ROS message types as DDS types: same names, same member order, same bytes (XCDR1)."""

from __future__ import annotations

import functools
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from agribot.ros.messages.char_types import replace_char
from agribot.ros.messages.dds_names import to_dds_name
from agribot.ros.messages.gps_types import IN_ROS2, register_gps_types

PLACEHOLDER = "structure_needs_at_least_one_member"  # member of a message without fields


@functools.cache
def load_dds_types() -> Typestore:
    store = get_typestore(Stores.ROS2_JAZZY)
    register_gps_types(store, IN_ROS2)
    replace_char(store)
    return store


@functools.cache
def make_dds_type(ros_type: str, store: Typestore) -> Any:
    """Make the description of a type of `store`; messages are written and read as bytes."""
    return _make_struct(ros_type, store, {})


@functools.cache
def make_dds_service_type(ros_type: str, store: Typestore) -> Any:
    """Make the description of a request or a response, which begins with the client's marks."""
    from cyclonedds.idl import types

    return _make_struct(ros_type, store, {"client": types.uint64, "number": types.int64})


def _make_struct(ros_type: str, store: Typestore, first: dict[str, Any]) -> Any:
    from cyclonedds.idl import make_idl_struct, types
    from cyclonedds.idl.annotations import final

    _, fields = store.fielddefs[ros_type]
    members = first | {name: _make_member(kind, store) for name, kind in fields}
    members = members or {PLACEHOLDER: types.uint8}
    struct: Any = make_idl_struct(f"{ros_type.rpartition('/')[2]}_", to_dds_name(ros_type), members)
    return final(struct)


def _make_member(kind: Any, store: Typestore) -> Any:
    from cyclonedds.idl import types

    make: Any = types
    node, detail = kind
    if node == Nodetype.NAME:
        return make_dds_type(detail, store)
    if node == Nodetype.BASE:
        name, limit = detail
        if name in {"string", "wstring"}:
            return make.bounded_str[limit] if limit else str
        if name == "bool":
            return bool
        return make.uint8 if name in {"octet", "byte"} else getattr(make, name)
    inner, count = detail
    element = _make_member(inner, store)
    if node == Nodetype.ARRAY:
        return make.array[element, count]
    return make.sequence[element, count] if count else make.sequence[element]
