"""AGRIBOT as a node of ROS 2 on DDS: topics out, cmd_vel in, and what a running robot serves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.dds.node import DdsNode
from agribot.ros.dds.service_server import DdsServiceServer
from agribot.ros.requests import Requests, read_twist_cdr
from agribot.ros.ros2.parameters import Value
from agribot.ros.ros2.robot_server import Ros2RobotServer

NODE = "agribot"


class DdsGateway:
    """Publishes `out`; takes cmd_vel (with `requests.allow_drive`).

    If it `serves`, there are services, goals, the inbound topics, and `settings` as parameters.

    Raises: BridgeError: cyclonedds is not installed, or the domain cannot be joined.
    """

    def __init__(
        self,
        requests: Requests,
        out: Sequence[Topic],
        *,
        domain: int = 0,
        serves: bool = True,
        settings: Mapping[str, Value] | None = None,
    ) -> None:
        self._requests = requests
        self._node = DdsNode(NODE, domain)
        self._writers = {
            topic.name: [self._node.create_publisher(named) for named in topic.list_named()]
            for topic in out
        }
        if requests.allow_drive:
            self._node.subscribe(topics.CMD_VEL, self._on_twist)
        self._server: DdsServiceServer | None = None
        self._robot: Ros2RobotServer | None = None
        if serves:
            self._server = DdsServiceServer(self._node, requests.refuse)
            self._robot = Ros2RobotServer(self._server, NODE, requests, settings or {})
        self._node.announce()

    def publish(self, topic: Topic, data: bytes, _t_ns: int) -> None:
        if self._requests.frames is not None:
            self._requests.frames.note(topic, data)
        for writer in self._writers.get(topic.name, ()):
            writer(data)

    def step(self, record: TickRecord) -> None:
        if self._robot is not None:
            self._robot.step(record)

    def close(self) -> None:
        if self._robot is not None:
            self._robot.close()
        if self._server is not None:
            self._server.close()
        self._robot = self._server = None
        self._writers.clear()
        self._node.close()

    def _on_twist(self, data: bytes) -> None:
        try:
            self._requests.request_twist(read_twist_cdr(data), "DDS")
        except BridgeError as error:
            self._requests.refuse(f"DDS: {topics.CMD_VEL.name}: {error}")
