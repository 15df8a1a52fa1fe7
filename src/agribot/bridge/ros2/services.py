"""Service types of ROS 2: the library of message types has none, so they are put together here."""

from __future__ import annotations

import functools
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

EVENT_INFO = "service_msgs/msg/ServiceEventInfo"
_SERVICES = {
    "std_srvs/srv/Trigger": ("", "bool success\nstring message\n"),
    "std_srvs/srv/SetBool": ("bool data\n", "bool success\nstring message\n"),
}
_PLACEHOLDER = "uint8 structure_needs_at_least_one_member\n"  # of an empty request or response


@functools.cache
def service_types() -> Typestore:
    """Messages of ROS 2 Jazzy with requests, responses and hashes of the services above."""
    store = get_typestore(Stores.ROS2_JAZZY)
    _mend_event_info(store)
    for name, (request, response) in _SERVICES.items():
        store.register({f"{name}_Request": _fields(request)})
        store.register({f"{name}_Response": _fields(response)})
        event: list[tuple[str, Any]] = [
            ("info", _named(EVENT_INFO)),
            ("request", _at_most_one(f"{name}_Request")),
            ("response", _at_most_one(f"{name}_Response")),
        ]
        service: list[tuple[str, Any]] = [
            ("request_message", _named(f"{name}_Request")),
            ("response_message", _named(f"{name}_Response")),
            ("event_message", _named(f"{name}_Event")),
        ]
        store.fielddefs[f"{name}_Event"] = ([], event)
        store.fielddefs[name] = ([], service)
    return store


def _fields(text: str) -> Any:
    """Constants and fields of a .msg text; rosbags would file it under msg/, so it has no name."""
    (definition,) = get_types_from_msg(text or _PLACEHOLDER, "agribot/msg/Part").values()
    return definition


def _mend_event_info(store: Typestore) -> None:
    """ROS 2 counts `char` as uint8 when it hashes; rosbags 0.11 does not."""
    constants, fields = store.fielddefs[EVENT_INFO]
    sixteen_bytes = (Nodetype.ARRAY, ((Nodetype.BASE, ("uint8", 0)), 16))
    mended: list[Any] = [
        (name, sixteen_bytes if name == "client_gid" else kind) for name, kind in fields
    ]
    store.fielddefs[EVENT_INFO] = (constants, mended)


def _named(ros_type: str) -> tuple[Nodetype, str]:
    return (Nodetype.NAME, ros_type)


def _at_most_one(ros_type: str) -> tuple[Nodetype, Any]:
    return (Nodetype.SEQUENCE, (_named(ros_type), 1))
