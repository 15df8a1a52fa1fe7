"""AGRIBOT as a node of ROS 2 on DDS: topics out, cmd_vel in, and what a running robot serves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from agribot.core import topics
from agribot.core.topics import Topic
from agribot.ros.dds.node import DdsNode
from agribot.ros.dds.service_server import DdsServiceServer
from agribot.ros.node_gateway import NodeGateway
from agribot.ros.requests import Requests
from agribot.ros.ros2.parameters import Value
from agribot.ros.ros2.robot_server import Ros2RobotServer

NODE = "agribot"


class DdsGateway(NodeGateway):
    """Publishes `out`; takes cmd_vel (with `requests.allow_drive`).

    If it `serves`, there are services, goals, the inbound topics, and `settings` as parameters.

    Raises: BridgeError: cyclonedds is not installed, or the domain cannot be joined.
    """

    source = "DDS"

    def __init__(
        self,
        requests: Requests,
        out: Sequence[Topic],
        *,
        domain: int = 0,
        serves: bool = True,
        settings: Mapping[str, Value] | None = None,
    ) -> None:
        super().__init__(requests)
        self._node = DdsNode(NODE, domain)
        self._writers = {
            topic.name: [self._node.create_publisher(named) for named in topic.list_named()]
            for topic in out
        }
        if requests.allow_drive:
            self._node.subscribe(topics.CMD_VEL, self._take_twist)
        self._server: DdsServiceServer | None = None
        if serves:
            self._server = DdsServiceServer(self._node, requests.refuse)
            self._robot = Ros2RobotServer(self._server, NODE, requests, settings or {})
        self._node.announce()

    def close(self) -> None:
        super().close()
        if self._server is not None:
            self._server.close()
        self._robot = self._server = None
        self._writers = {}
        self._node.close()
