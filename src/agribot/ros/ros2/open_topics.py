"""The topics of a ROS 2 domain over zenoh, each heard as long as somebody looks at it."""

from __future__ import annotations

import os
from collections.abc import Callable

from rosbags.typesys.store import Typestore

from agribot.core.topics import STREAM, Topic
from agribot.ros.display_requests import TakeDisplay
from agribot.ros.graph import Graph
from agribot.ros.ros2 import wire
from agribot.ros.ros2.connection import NO_HASH
from agribot.ros.ros2.display_service import serve_displays
from agribot.ros.ros2.node import Ros2Node
from agribot.ros.ros2.service_server import ServiceServer
from agribot.ros.ros2.system_state import read_graph
from agribot.ros.topic_network import OnBytes, check_definition


class Ros2Topics:
    """Joins the router at `router` when it is first asked, and never takes its role.

    `types` are those that can be read: a type of another definition is refused.
    """

    is_ros2 = True

    def __init__(self, name: str, domain: int, router: str, types: Callable[[], Typestore]) -> None:
        self._name = f"{name}_{os.getpid()}"
        self._domain, self._router, self._types = domain, router, types
        self._node: Ros2Node | None = None

    def read_graph(self) -> Graph:
        return read_graph(self._join())

    def open_topic(self, name: str, on_bytes: OnBytes) -> Ros2Topic | None:
        node = self._join()
        node.check_router()
        announced = (wire.read_publisher(token) for token in node.list_tokens())
        found = next((one for one in announced if one is not None and one.name == name), None)
        if found is None:
            return None
        type_hash = "" if found.type_hash == NO_HASH else found.type_hash
        check_definition(self._types(), name, found.ros_type, type_hash, found.node)
        end = node.subscribe_found(found, lambda data: on_bytes(found.ros_type, data))
        return Ros2Topic(end)

    def take_texts(self, name: str, on_bytes: OnBytes) -> Ros2Topic:
        topic = Topic(name=name, ros_type="std_msgs/msg/String", qos=STREAM)
        node = self._join()
        node.subscribe(topic, lambda data: on_bytes(topic.ros_type, data), topic.qos)
        return Ros2Topic(lambda: None)  # it ends with the node

    def serve_displays(self, take: TakeDisplay) -> None:
        serve_displays(ServiceServer(self._join(), lambda _text: None), take)

    def close(self) -> None:
        if self._node is not None:
            self._node.close()
            self._node = None

    def _join(self) -> Ros2Node:
        if self._node is None:
            self._node = Ros2Node(self._name, self._domain, self._router, listen=False)
        return self._node


class Ros2Topic:
    """A topic that is heard."""

    def __init__(self, end: Callable[[], None]) -> None:
        self._end = end

    def close(self) -> None:
        self._end()
