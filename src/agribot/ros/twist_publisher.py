"""A node that does nothing but publish twists, to any robot of ROS 1 or ROS 2."""

from __future__ import annotations

import os
import re
import socket
import time
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import NamedTuple, Self
from urllib.parse import urlsplit

from agribot.core.errors import BridgeError, ConfigError
from agribot.core.topics import CMD_VEL, Topic
from agribot.ros.messages import rosmsg
from agribot.ros.messages.cdr import CdrTemplate

NODE = "agribot_teleop"
STAMPED = "geometry_msgs/msg/TwistStamped"
STOPS, STOP_PERIOD_S = 5, 0.05  # zeros at the end; one may be lost

_NAME = re.compile(r"(/[A-Za-z][A-Za-z0-9_]*)+")
_FRAME = "base_link"


class TwistSink(NamedTuple):
    """Target of twists in CDR; `describe` names its place and who listens there."""

    send: Callable[[bytes], None]
    close: Callable[[], None]
    describe: Callable[[], str]


class TwistPublisher:
    """Publishes twists; on leaving its context it stops the robot, whatever ended it."""

    def __init__(
        self, sink: TwistSink, *, is_stamped: bool, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._sink, self._sleep = sink, sleep
        self._twist = CdrTemplate(rosmsg.make_twist(0.0, 0.0), "d32xd")
        self._stamped = CdrTemplate(_make_stamped(), "d32xd") if is_stamped else None

    def drive(self, v_mps: float, yaw_rate_radps: float) -> None:
        """Publish one twist.

        Raises: BridgeError: the network was lost.
        """
        if self._stamped is None:
            self._sink.send(self._twist.fill(v_mps, yaw_rate_radps))
        else:
            self._sink.send(self._stamped.fill_stamped(time.time_ns(), v_mps, yaw_rate_radps))

    def describe(self) -> str:
        return self._sink.describe()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:  # fmt: skip
        with ExitStack() as closing:
            closing.callback(self._sink.close)
            for _ in range(STOPS):
                self.drive(0.0, 0.0)
                self._sleep(STOP_PERIOD_S)


def make_twist_topic(name: str, *, is_stamped: bool) -> Topic:
    """Make the topic to publish on.

    Raises: ConfigError: it is no name of a topic.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"--topic {name}: not a name; write one such as {CMD_VEL.name} or /cmd_vel"
        )
    return Topic(name=name, ros_type=STAMPED if is_stamped else CMD_VEL.ros_type)


def open_ros1_sink(topic: Topic, master_uri: str) -> TwistSink:
    """Open a node at a ROS 1 master, on the address that leads to it.

    Raises: BridgeError: no master answers.
    """
    from agribot.ros.ros1.node import Node
    from agribot.ros.ros1.types import list_outputs

    node = Node(NODE, master_uri, find_own_host(master_uri), may_rename=True)
    (output,) = list_outputs(topic)
    publication = node.advertise(output.name, output.ros_type, latched=False, depth=1)

    def describe() -> str:
        count = publication.listeners
        return f"{count} listening on {topic.name}" if count else f"no node listens on {topic.name}"

    return TwistSink(lambda data: publication.put(output.convert(data)), node.close, describe)


def open_ros2_sink(topic: Topic, domain: int, router: str) -> TwistSink:
    """Open a node at a zenoh router, which it becomes itself where none runs.

    Raises: BridgeError: zenoh is not installed, or neither role is possible.
    """
    from agribot.ros.ros2.node import Ros2Node

    node = Ros2Node(NODE, domain, router, listen=True)
    publisher = node.create_publisher(topic)
    return TwistSink(publisher, node.close, lambda: f"{topic.name} at {router}, domain {domain}")


def open_dds_sink(topic: Topic, domain: int) -> TwistSink:
    """Open a node in a domain of DDS.

    Raises: BridgeError: cyclonedds is not installed, or the domain cannot be joined.
    """
    from agribot.ros.dds.node import DdsNode

    node = DdsNode(NODE, domain)
    publisher = node.create_publisher(topic)
    node.announce()
    return TwistSink(publisher, node.close, lambda: f"{topic.name} on DDS, domain {domain}")


def find_own_host(master_uri: str) -> str:
    """Find this machine's address as peers of the master see it: ROS_IP, or the way to it."""
    host = os.environ.get("ROS_IP") or os.environ.get("ROS_HOSTNAME")
    if host:
        return host
    parts = urlsplit(master_uri)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
            way.connect((parts.hostname or "", parts.port or 11311))  # sends nothing
            return str(way.getsockname()[0])
    except OSError as error:
        raise BridgeError(
            f"ROS 1: no way to the master {master_uri}: {error}; check its host name, or set ROS_IP"
        ) from error


def _make_stamped() -> object:
    return rosmsg.make_message(STAMPED, rosmsg.make_header(0.0, _FRAME), rosmsg.make_twist(0, 0))
