"""AGRIBOT as a node of a ROS 1 master, under its own names and those of the original."""

from __future__ import annotations

from collections.abc import Sequence

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.requests import Requests
from agribot.ros.ros1.master import MASTER
from agribot.ros.ros1.node import Node, Publication
from agribot.ros.ros1.robot_server import RobotServer
from agribot.ros.ros1.subscription import Subscription
from agribot.ros.ros1.types import Convert, list_outputs, read_twist


class Ros1Gateway:
    """Publishes `out`, sets robot_description and use_sim_time, takes cmd_vel if allowed.

    If it `serves`, there are services, goals, and the inbound topics.
    Raises: BridgeError: no master answers.
    """

    def __init__(
        self,
        requests: Requests,
        out: Sequence[Topic],
        urdf: str,
        master_uri: str = MASTER,
        *,
        serves: bool = True,
    ) -> None:
        self._requests = requests
        self._subscription: Subscription | None = None
        self._robot: RobotServer | None = None
        self._node = Node("agribot", master_uri)
        try:
            self._node.set_param("/robot_description", urdf)
            self._node.set_param("/use_sim_time", any(t is topics.CLOCK for t in out))
            self._outputs = {topic.name: self._advertise(topic) for topic in out}
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
        published = (p for outputs_of in self._outputs.values() for p, _ in outputs_of)
        return tuple(p.name for p in published if not p.listeners)

    def publish(self, topic: Topic, data: bytes, _t_ns: int) -> None:
        if self._requests.frames is not None:
            self._requests.frames.note(topic, data)
        for publication, convert in self._outputs.get(topic.name, ()):
            if publication.is_wanted:
                publication.put(convert(data))

    def step(self, record: TickRecord) -> None:
        if self._robot is not None:
            self._robot.step(record)

    def close(self) -> None:
        if self._robot is not None:
            self._robot.close()
        if self._subscription is not None:
            self._subscription.close()
        self._node.close()

    def _advertise(self, topic: Topic) -> list[tuple[Publication, Convert]]:
        return [
            (
                self._node.advertise(o.name, o.ros_type, latched=o.latched, depth=o.depth),
                o.convert,
            )
            for o in list_outputs(topic)
        ]

    def _on_twist(self, data: bytes, source: str, _ros_type: str) -> None:
        twist = read_twist(data)
        if twist is None:
            self._requests.refuse(f"{source}: {len(data)} bytes are no geometry_msgs/Twist")
        else:
            self._requests.request_twist(twist, source)
