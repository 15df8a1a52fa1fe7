"""What a running robot takes over ROS 1: services, goals, and the inbound topics."""

from __future__ import annotations

from agribot.core.errors import BridgeError
from agribot.core.inbound_topics import INBOUND_TOPICS
from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.inbound import InboundTopics
from agribot.ros.requests import Requests
from agribot.ros.ros1.move_base import MoveBaseServer
from agribot.ros.ros1.node import Node
from agribot.ros.ros1.robot_services import serve_robot
from agribot.ros.ros1.subscription import Subscription
from agribot.ros.ros1.types import find_input


class RobotServer:
    """Serves peers of one node; the same requests and rules as in every other network.

    Raises: BridgeError: the master refuses a name.
    """

    def __init__(self, node: Node, requests: Requests) -> None:
        self._requests = requests
        self._services = serve_robot(node, requests)
        try:
            self._actions = MoveBaseServer(node, requests)
            self._inbound = InboundTopics(requests, self._actions.goals, self._actions.goals)
            self._subscriptions = [self._subscribe(node, topic) for topic in INBOUND_TOPICS]
        except BridgeError:
            self._services.close()
            raise

    def step(self, record: TickRecord) -> None:
        self._actions.step(record)

    def close(self) -> None:
        for subscription in self._subscriptions:
            subscription.close()
        self._actions.close()
        self._services.close()

    def _subscribe(self, node: Node, topic: Topic) -> Subscription:
        name, ros_type, convert = find_input(topic)

        def on_bytes(data: bytes, source: str, _ros_type: str) -> None:
            try:
                cdr = convert(data)
            except BridgeError as error:
                self._requests.refuse(f"{source}: {name}: {error}")
            else:
                self._inbound.take(topic, cdr, source)

        return Subscription(node, name, ros_type, on_bytes, self._requests.refuse)
