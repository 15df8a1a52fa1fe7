"""A node of a ROS 1 master, under the original's names where it had some."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agribot.core.errors import BridgeError
from agribot.core.topics import Topic
from agribot.ros.ros1.hearing import ANY, Hearing
from agribot.ros.ros1.master import MASTER
from agribot.ros.ros1.node import Node, Publication
from agribot.ros.ros1.types import Convert, inlet, outputs, ros1_name, ros1_types


class Ros1Link:
    """Hears the original's topics with the original's types; says them and our own.

    `refused` hears why a publisher or a message is not taken.
    Raises: BridgeError: no master answers.
    """

    def __init__(self, name: str, refused: Callable[[str], None], master_uri: str = MASTER) -> None:
        self._node, self._refused = Node(name, master_uri), refused
        self._hearings: list[Hearing] = []
        self._outputs: dict[str, list[tuple[Publication, Convert]]] = {}

    def hear(self, topic: Topic, heard: Callable[[bytes], None]) -> None:
        name, ros_type, convert = inlet(topic)

        def arrived(data: bytes, source: str, _ros_type: str) -> None:
            try:
                cdr = convert(data)
            except BridgeError as error:
                self._refused(f"{source}: {name}: {error}")
            else:
                heard(cdr)

        self._hearings.append(Hearing(self._node, name, ros_type, arrived, self._refused))

    def hear_any(self, name: str, heard: Callable[[str, bytes], None]) -> None:
        def arrived(data: bytes, _source: str, ros_type: str) -> None:
            heard(ros_type, data)

        self._hearings.append(Hearing(self._node, name, ANY, arrived, self._refused))

    def decode(self, ros_type: str, data: bytes) -> Any:
        try:
            return ros1_types().deserialize_ros1(data, ros_type)
        except Exception as error:  # rosbags raises what its generated code happens to raise
            raise BridgeError(f"{len(data)} bytes are no {ros1_name(ros_type)}") from error

    def advertise(self, topic: Topic) -> None:
        self._outputs[topic.name] = [
            (
                self._node.advertise(o.name, o.ros_type, latched=o.latched, depth=o.depth),
                o.convert,
            )
            for o in outputs(topic)
        ]

    def publish(self, topic: Topic, data: bytes) -> None:
        for publication, convert in self._outputs[topic.name]:
            if publication.is_wanted:
                publication.put(convert(data))

    def close(self) -> None:
        for hearing in self._hearings:
            hearing.close()
        self._node.close()
