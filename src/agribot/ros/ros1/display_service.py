"""mapviz/AddMapvizDisplay of ROS 1, with which a program adds displays to the page's map."""

from __future__ import annotations

import functools

from rosbags.typesys.store import Typestore

from agribot.core.errors import BridgeError
from agribot.ros.decoding import make_undecodable
from agribot.ros.display_requests import (
    ADD_DISPLAY_SERVICE,
    TakeDisplay,
    read_display,
    wait_for_outcome,
)
from agribot.ros.ros1.node import Node
from agribot.ros.ros1.route_types import NestedServiceType
from agribot.ros.ros1.service_server import Ros1ServiceServer
from agribot.ros.ros1.types import add_ros1_types

_REQUEST = "mapviz/msg/AddMapvizDisplayRequest"
_RESPONSE = "mapviz/msg/AddMapvizDisplayResponse"
_TEXTS = {
    _REQUEST: "string name\nstring type\nint32 draw_order\nbool visible\n"
    "marti_common_msgs/KeyValue[] properties\n",
    _RESPONSE: "bool success\nstring message\n",
}
ADD_DISPLAY = NestedServiceType("mapviz/AddMapvizDisplay", *_TEXTS.values())


def serve_displays(node: Node, take: TakeDisplay) -> Ros1ServiceServer:
    """Serve the service at the master, where it takes the place of a mapviz's.

    Raises: BridgeError: the master refuses it.
    """
    server = Ros1ServiceServer(node, lambda _text: None)

    def answer(data: bytes, _source: str) -> bytes:
        types = load_display_types()
        try:
            request = types.deserialize_ros1(data, _REQUEST)
        except Exception as error:  # the generated code of rosbags raises any error
            raise make_undecodable(data, f"a request of {ADD_DISPLAY.name}") from error
        response = types.types[_RESPONSE](*wait_for_outcome(take, read_display(request)))
        return bytes(types.serialize_ros1(response, _RESPONSE))

    try:
        server.serve(ADD_DISPLAY_SERVICE, ADD_DISPLAY, answer)
    except BridgeError:
        server.close()
        raise
    return server


@functools.cache
def load_display_types() -> Typestore:
    return add_ros1_types(_TEXTS)
