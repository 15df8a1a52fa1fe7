"""The topics of a ROS 1 master, each heard as long as somebody looks at it."""

from __future__ import annotations

import os
from collections.abc import Callable

from agribot.ros.display_requests import TakeDisplay
from agribot.ros.graph import Graph
from agribot.ros.ros1.display_service import serve_displays
from agribot.ros.ros1.node import Node
from agribot.ros.ros1.service_server import Ros1ServiceServer
from agribot.ros.ros1.subscription import ANY, Subscription
from agribot.ros.ros1.system_state import read_graph
from agribot.ros.topic_network import OnBytes


class Ros1Topics:
    """A node of ours is at the master from the first topic on.

    `on_refusal` is called with the reason for which a publisher is rejected.
    """

    is_ros2 = False

    def __init__(
        self, name: str, master_uri: str, on_refusal: Callable[[str], None] = lambda _text: None
    ) -> None:
        self._name, self._master_uri = f"{name}_{os.getpid()}", master_uri
        self._on_refusal = on_refusal
        self._node: Node | None = None
        self._services: Ros1ServiceServer | None = None

    def read_graph(self) -> Graph:
        return read_graph(self._master_uri)

    def open_topic(self, name: str, on_bytes: OnBytes) -> Ros1Topic:
        node = self._join()

        def on_message(data: bytes, _source: str, ros_type: str) -> None:
            on_bytes(ros_type, data)

        subscription = Subscription(node, name, ANY, on_message, self._on_refusal)
        return Ros1Topic(node, name, subscription)

    def take_texts(self, name: str, on_bytes: OnBytes) -> Ros1Topic:
        return self.open_topic(name, on_bytes)

    def serve_displays(self, take: TakeDisplay) -> None:
        self._services = serve_displays(self._join(), take)

    def close(self) -> None:
        if self._services is not None:
            self._services.close()
            self._services = None
        if self._node is not None:
            self._node.close()
            self._node = None

    def _join(self) -> Node:
        if self._node is None:
            self._node = Node(self._name, self._master_uri)
        return self._node


class Ros1Topic:
    """A topic that is heard."""

    def __init__(self, node: Node, name: str, subscription: Subscription) -> None:
        self._node, self._name, self._subscription = node, name, subscription

    def close(self) -> None:
        self._node.unsubscribe(self._name)
        self._subscription.close()
