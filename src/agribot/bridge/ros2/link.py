"""A node on the network of ROS 2."""

from __future__ import annotations

from collections.abc import Callable

from agribot.bridge.ros2.node import ROUTER, Ros2Node, Writer
from agribot.topic import Topic


class Ros2Link:
    """Joins the router at `router`.

    Raises: BridgeError: zenoh is not installed, or no router answers.
    """

    def __init__(self, name: str, *, domain: int = 0, router: str = ROUTER) -> None:
        self._node = Ros2Node(name, domain, router, listen=False)
        self._writers: dict[str, Writer] = {}

    def hear(self, topic: Topic, heard: Callable[[bytes], None]) -> None:
        self._node.hear(topic, heard, topic.qos)

    def advertise(self, topic: Topic) -> None:
        self._writers[topic.name] = self._node.writer(topic)

    def publish(self, topic: Topic, data: bytes) -> None:
        self._writers[topic.name](data)

    def close(self) -> None:
        self._node.close()
