"""A connection to the network of ROS 2."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agribot.core.topics import Topic
from agribot.ros.decoding import make_undecodable
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.ros2.node import ROUTER, Ros2Node, TopicPublisher

NO_HASH = "TypeHashNotSupported"  # hash of ROS 2 Humble


class Ros2Connection:
    """Joins the router at `router`, or with `listen` takes its role where none is there.

    Raises: BridgeError: zenoh is not installed, or no router answers.
    """

    def __init__(
        self, name: str, *, domain: int = 0, router: str = ROUTER, listen: bool = False
    ) -> None:
        self._node = Ros2Node(name, domain, router, listen=listen)
        self._writers: dict[str, TopicPublisher] = {}

    def subscribe(self, topic: Topic, on_message: Callable[[bytes], None]) -> None:
        self._node.subscribe(topic, on_message, topic.qos)

    def subscribe_any(self, name: str, on_message: Callable[[str, bytes], None]) -> None:
        """Subscribe to a topic; a type of another definition arrives without its bytes."""

        def on_bytes(ros_type: str, type_hash: str, data: bytes) -> None:
            is_ours = ros_type in load_types().types and type_hash in {
                load_types().hash_rihs01(ros_type),
                NO_HASH,
            }
            on_message(ros_type, data if is_ours else b"")

        self._node.subscribe_any(name, on_bytes)

    def decode(self, ros_type: str, data: bytes) -> Any:
        try:
            return load_types().deserialize_cdr(data, ros_type)
        except Exception as error:  # the generated code of rosbags raises any error
            raise make_undecodable(data, f"{ros_type} of ROS 2 Jazzy") from error

    def list_topics(self) -> dict[str, str]:
        return self._node.list_topics()

    def advertise(self, topic: Topic) -> None:
        self._writers[topic.name] = self._node.create_publisher(topic)

    def publish(self, topic: Topic, data: bytes) -> None:
        self._writers[topic.name](data)

    def close(self) -> None:
        self._node.close()
