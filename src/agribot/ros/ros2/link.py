"""A node on the network of ROS 2."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agribot.core.errors import BridgeError
from agribot.core.topics import Topic
from agribot.ros.messages.rosmsg import typestore
from agribot.ros.ros2.node import ROUTER, Ros2Node, Writer

NO_HASH = "TypeHashNotSupported"  # of ROS 2 Humble


class Ros2Link:
    """Joins the router at `router`, or with `listen` takes its role where none is there.

    Raises: BridgeError: zenoh is not installed, or no router answers.
    """

    def __init__(
        self, name: str, *, domain: int = 0, router: str = ROUTER, listen: bool = False
    ) -> None:
        self._node = Ros2Node(name, domain, router, listen=listen)
        self._writers: dict[str, Writer] = {}

    def hear(self, topic: Topic, heard: Callable[[bytes], None]) -> None:
        self._node.hear(topic, heard, topic.qos)

    def hear_any(self, name: str, heard: Callable[[str, bytes], None]) -> None:
        """A type of another definition arrives without its bytes, which nobody could read."""

        def arrived(ros_type: str, type_hash: str, data: bytes) -> None:
            is_ours = ros_type in typestore().types and type_hash in {
                typestore().hash_rihs01(ros_type),
                NO_HASH,
            }
            heard(ros_type, data if is_ours else b"")

        self._node.hear_any(name, arrived)

    def decode(self, ros_type: str, data: bytes) -> Any:
        try:
            return typestore().deserialize_cdr(data, ros_type)
        except Exception as error:  # rosbags raises what its generated code happens to raise
            raise BridgeError(f"{len(data)} bytes are no {ros_type} of ROS 2 Jazzy") from error

    def advertise(self, topic: Topic) -> None:
        self._writers[topic.name] = self._node.writer(topic)

    def publish(self, topic: Topic, data: bytes) -> None:
        self._writers[topic.name](data)

    def close(self) -> None:
        self._node.close()
