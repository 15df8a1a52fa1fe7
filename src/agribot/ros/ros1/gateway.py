"""AGRIBOT as a node of a ROS 1 master, under its own names and those of the original."""

from __future__ import annotations

from collections.abc import Sequence

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.topics import Topic
from agribot.ros.node_gateway import NodeGateway, Writer
from agribot.ros.requests import Requests
from agribot.ros.ros1.master import MASTER
from agribot.ros.ros1.node import Node, Publication
from agribot.ros.ros1.robot_server import RobotServer
from agribot.ros.ros1.subscription import Subscription
from agribot.ros.ros1.types import OutputTopic, list_outputs, read_twist


class Ros1Gateway(NodeGateway):
    """Publishes `out`, sets robot_description and use_sim_time, takes cmd_vel if allowed.

    If it `serves`, there are services, goals, and the inbound topics.
    Raises: BridgeError: no master answers.
    """

    source = "ROS 1"

    def __init__(
        self,
        requests: Requests,
        out: Sequence[Topic],
        urdf: str,
        master_uri: str = MASTER,
        namespace: str = "",
        *,
        serves: bool = True,
    ) -> None:
        super().__init__(requests)
        self._publications: list[Publication] = []
        self._subscription: Subscription | None = None
        self._node = Node("agribot", master_uri, namespace=namespace)
        try:
            self._node.set_param("/robot_description", urdf)
            self._node.set_param("/use_sim_time", any(t is topics.CLOCK for t in out))
            self._writers = {t.name: [*map(self._advertise, list_outputs(t))] for t in out}
            if requests.allow_drive:
                topic = topics.CMD_VEL
                self._subscription = Subscription(
                    self._node, topic.name, topic.ros_type, self._on_twist, requests.refuse
                )
            if serves:
                self._robot = RobotServer(self._node, requests)
        except BridgeError:
            self.close()
            raise

    @property
    def unsubscribed(self) -> tuple[str, ...]:
        """The names of the published topics that have no subscriber now."""
        return tuple(one.name for one in self._publications if not one.listeners)

    def close(self) -> None:
        super().close()
        if self._subscription is not None:
            self._subscription.close()
        self._node.close()

    def _advertise(self, output: OutputTopic) -> Writer:
        publication = self._node.advertise(
            output.name, output.ros_type, latched=output.latched, depth=output.depth
        )
        self._publications.append(publication)

        def write(data: bytes) -> None:
            if publication.is_wanted:
                publication.put(output.convert(data))

        return write

    def _on_twist(self, data: bytes, source: str, _ros_type: str) -> None:
        twist = read_twist(data)
        if twist is None:
            self._requests.refuse(f"{source}: {len(data)} bytes are no geometry_msgs/Twist")
        else:
            self._requests.request_twist(twist, source)
