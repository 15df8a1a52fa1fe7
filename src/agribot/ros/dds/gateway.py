"""AGRIBOT as a node of ROS 2 on DDS: topics out, cmd_vel and the inbound topics in.

No services: rmw_cyclonedds and rmw_fastrtps put the request's id in different places, so that
neither would understand the other; `Ros2Gateway` has them. The topic of commands stands in.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.inbound_topics import INBOUND_TOPICS
from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.dds.node import DdsNode
from agribot.ros.goals import GoalBook, PeerGoal
from agribot.ros.inbound import InboundTopics
from agribot.ros.requests import Requests, read_twist_cdr

NODE = "agribot"
_SOURCE = "DDS"


class DdsGateway:
    """Publishes `out`; takes cmd_vel if allowed, and the inbound topics if it `serves`.

    Raises: BridgeError: cyclonedds is not installed, or the domain cannot be joined.
    """

    def __init__(
        self, requests: Requests, out: Sequence[Topic], *, domain: int = 0, serves: bool = True
    ) -> None:
        self._requests = requests
        self._node = DdsNode(NODE, domain)
        self._writers = {topic.name: self._node.create_publisher(topic) for topic in out}
        if requests.allow_drive:
            self._node.subscribe(topics.CMD_VEL, self._on_twist)
        self._goals = GoalBook(requests, self._report_end)
        self._inbound = InboundTopics(requests, self._goals, self._goals)
        for topic in INBOUND_TOPICS if serves else ():
            self._node.subscribe(topic, functools.partial(self._on_inbound, topic))
        self._node.announce()

    def publish(self, topic: Topic, data: bytes, _t_ns: int) -> None:
        if self._requests.frames is not None:
            self._requests.frames.note(topic, data)
        writer = self._writers.get(topic.name)
        if writer is not None:
            writer(data)

    def step(self, record: TickRecord) -> None:
        self._goals.step(record)

    def close(self) -> None:
        self._writers.clear()
        self._node.close()

    def _on_inbound(self, topic: Topic, data: bytes) -> None:
        self._inbound.take(topic, data, _SOURCE)

    def _report_end(self, goal: PeerGoal) -> None:
        """Report the end of a goal, which no topic of DDS carries."""
        if goal.is_over and goal.state not in {"rejected", "aborted"}:  # these are reported
            self._requests.refuse(f"{_SOURCE}: goal {goal.state}: {goal.reason}")

    def _on_twist(self, data: bytes) -> None:
        try:
            self._requests.request_twist(read_twist_cdr(data), _SOURCE)
        except BridgeError as error:
            self._requests.refuse(f"{_SOURCE}: {topics.CMD_VEL.name}: {error}")
