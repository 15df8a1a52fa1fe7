"""mapviz_interfaces/AddMapvizDisplay of ROS 2: a program adds displays to the page's map."""

from __future__ import annotations

import functools
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from agribot.ros.display_requests import ADD_DISPLAY_SERVICE, TakeDisplay, read_display
from agribot.ros.messages.gps_types import read_shipped_texts
from agribot.ros.ros2.services import add_service
from agribot.ros.ros2.serving import Reply, ServingNode

ADD_DISPLAY = "mapviz_interfaces/srv/AddMapvizDisplay"
_KEY_VALUE = "marti_common_msgs/msg/KeyValue"
_REQUEST = """string name
string type
int32 draw_order
bool visible
marti_common_msgs/KeyValue[] properties
"""
_RESPONSE = "bool success\nstring message\n"


def serve_displays(node: ServingNode, take: TakeDisplay) -> None:
    def answer(request: Any, reply: Reply) -> None:
        take(read_display(request), reply)

    node.serve(load_display_types(), ADD_DISPLAY_SERVICE, ADD_DISPLAY, answer)


@functools.cache
def load_display_types() -> Typestore:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(read_shipped_texts()[_KEY_VALUE], _KEY_VALUE))
    add_service(store, ADD_DISPLAY, _REQUEST, _RESPONSE)
    return store
