"""The topics of a ROS 2 domain on DDS, each heard as long as somebody looks at it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

from rosbags.typesys.store import Typestore

from agribot.core.topics import STREAM, Qos, Topic
from agribot.ros.dds.discovery import Discovery
from agribot.ros.dds.node import DdsNode
from agribot.ros.dds.service_server import DdsServiceServer
from agribot.ros.display_requests import TakeDisplay
from agribot.ros.graph import Graph
from agribot.ros.ros2.display_service import serve_displays
from agribot.ros.topic_network import OnBytes, check_definition

_LOOK_S = 0.1
_QUIET_S = 0.5  # time without a new writer after which all are found
_MOST_WAIT_S = 3.0


class DdsTopics:
    """Joins the domain when it is first asked.

    `types` are those that can be read: a type of another definition is refused.
    """

    is_ros2 = True

    def __init__(self, name: str, domain: int, types: Callable[[], Typestore]) -> None:
        self._name, self._domain, self._types = f"{name}_{os.getpid()}", domain, types
        self._joined: tuple[DdsNode, Discovery] | None = None
        self._server: DdsServiceServer | None = None

    def read_graph(self) -> Graph:
        return self._join()[1].read_graph()

    def open_topic(self, name: str, on_bytes: OnBytes) -> DdsTopic | None:
        node, discovery = self._join()
        found = [one for one in discovery.list_writers() if one.name == name]
        if not found:
            return None
        first = found[0]
        check_definition(self._types(), name, first.ros_type, first.type_hash, first.node)
        qos = Qos(  # the qualities that every writer of this topic offers
            reliable=all(one.qos.reliable for one in found),
            latched=all(one.qos.latched for one in found),
        )
        return self._hear(node, Topic(name=name, ros_type=first.ros_type, qos=qos), on_bytes)

    def take_texts(self, name: str, on_bytes: OnBytes) -> DdsTopic:
        topic = Topic(name=name, ros_type="std_msgs/msg/String", qos=STREAM)
        return self._hear(self._join()[0], topic, on_bytes)

    def serve_displays(self, take: TakeDisplay) -> None:
        node, _ = self._join()
        self._server = DdsServiceServer(node, lambda _text: None)
        serve_displays(self._server, take)
        node.announce()

    def close(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
        if self._joined is not None:
            node, _ = self._joined
            self._joined = None
            node.close()

    def _hear(self, node: DdsNode, topic: Topic, on_bytes: OnBytes) -> DdsTopic:
        ros_type = topic.ros_type
        end = node.subscribe(topic, lambda data: on_bytes(ros_type, data), self._types())
        node.announce()
        return DdsTopic(end)

    def _join(self) -> tuple[DdsNode, Discovery]:
        if self._joined is None:
            node = DdsNode(self._name, self._domain)
            self._joined = node, Discovery(node)
            _wait_until_found(self._joined[1])
        return self._joined


class DdsTopic:
    """A topic that is heard."""

    def __init__(self, end: Callable[[], None]) -> None:
        self._end = end

    def close(self) -> None:
        self._end()


def _wait_until_found(discovery: Discovery) -> None:
    """Wait for the answers of those who are there: nothing says that all have answered."""
    started_s = changed_s = time.monotonic()
    count = 0
    while (now_s := time.monotonic()) < min(changed_s + _QUIET_S, started_s + _MOST_WAIT_S):
        time.sleep(_LOOK_S)
        found = len(discovery.list_writers())
        if found != count:
            count, changed_s = found, now_s
