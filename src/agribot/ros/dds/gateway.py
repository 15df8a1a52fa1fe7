"""AGRIBOT as a node of ROS 2 on DDS: topics out, cmd_vel in.

No services: rmw_cyclonedds and rmw_fastrtps put the request's id in different places, so that
neither would understand the other; `Ros2Gateway` has them.
"""

from __future__ import annotations

from collections.abc import Sequence

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.dds.node import DdsNode
from agribot.ros.requests import Requests, read_twist_cdr

NODE = "agribot"


class DdsGateway:
    """Publishes `out`; takes cmd_vel if allowed.

    Raises: BridgeError: cyclonedds is not installed, or the domain cannot be joined.
    """

    def __init__(self, requests: Requests, out: Sequence[Topic], *, domain: int = 0) -> None:
        self._requests = requests
        self._node = DdsNode(NODE, domain)
        self._writers = {
            topic.name: [self._node.create_publisher(named) for named in topic.list_named()]
            for topic in out
        }
        if requests.allow_drive:
            self._node.subscribe(topics.CMD_VEL, self._on_twist)
        self._node.announce()

    def publish(self, topic: Topic, data: bytes, _t_ns: int) -> None:
        for writer in self._writers.get(topic.name, ()):
            writer(data)

    def step(self, _record: TickRecord) -> None:
        """Do nothing: all is in the topics."""

    def close(self) -> None:
        self._writers.clear()
        self._node.close()

    def _on_twist(self, data: bytes) -> None:
        try:
            self._requests.request_twist(read_twist_cdr(data), "DDS")
        except BridgeError as error:
            self._requests.refuse(f"DDS: {topics.CMD_VEL.name}: {error}")
