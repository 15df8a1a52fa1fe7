"""A connection to a ROS 1 master, with the original's topic names where it had some."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agribot.core.errors import BridgeError
from agribot.core.topics import Topic
from agribot.ros.decoding import make_undecodable
from agribot.ros.ros1.master import MASTER
from agribot.ros.ros1.node import Node, Publication
from agribot.ros.ros1.subscription import ANY, Subscription
from agribot.ros.ros1.types import Convert, find_input, list_outputs, load_ros1_types, to_ros1_name


class Ros1Connection:
    """Subscribes to the original's topics and types; publishes them and our own.

    `on_refusal` is called with the reason for which a publisher or a message is rejected.
    Raises: BridgeError: no master answers.
    """

    def __init__(
        self,
        name: str,
        on_refusal: Callable[[str], None],
        master_uri: str = MASTER,
        namespace: str = "",
    ) -> None:
        self._node = Node(name, master_uri, namespace=namespace, may_rename=True)
        self._on_refusal = on_refusal
        self._subscriptions: list[Subscription] = []
        self._outputs: dict[str, list[tuple[Publication, Convert]]] = {}

    def subscribe(self, topic: Topic, on_message: Callable[[bytes], None]) -> None:
        name, ros_type, convert = find_input(topic)

        def on_bytes(data: bytes, source: str, _ros_type: str) -> None:
            try:
                cdr = convert(data)
            except BridgeError as error:
                self._on_refusal(f"{source}: {name}: {error}")
            else:
                on_message(cdr)

        self._subscriptions.append(
            Subscription(self._node, name, ros_type, on_bytes, self._on_refusal)
        )

    def subscribe_any(self, name: str, on_message: Callable[[str, bytes], None]) -> None:
        def on_bytes(data: bytes, _source: str, ros_type: str) -> None:
            on_message(ros_type, data)

        self._subscriptions.append(Subscription(self._node, name, ANY, on_bytes, self._on_refusal))

    def decode(self, ros_type: str, data: bytes) -> Any:
        try:
            return load_ros1_types().deserialize_ros1(data, ros_type)
        except Exception as error:  # the generated code of rosbags raises any error
            raise make_undecodable(data, to_ros1_name(ros_type)) from error

    def list_topics(self) -> dict[str, str]:
        published = self._node.ask_master("getPublishedTopics", "")
        return {name: "/msg/".join(ros_type.split("/")) for name, ros_type in published}

    def advertise(self, topic: Topic) -> None:
        self._outputs[topic.name] = [
            (
                self._node.advertise(o.name, o.ros_type, latched=o.latched, depth=o.depth),
                o.convert,
            )
            for o in list_outputs(topic)
        ]

    def publish(self, topic: Topic, data: bytes) -> None:
        for publication, convert in self._outputs[topic.name]:
            if publication.is_wanted:
                publication.put(convert(data))

    def close(self) -> None:
        for hearing in self._subscriptions:
            hearing.close()
        self._node.close()
