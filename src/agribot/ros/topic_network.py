"""A network whose topics one can list, hear and leave again, whatever their types."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from rosbags.typesys.store import Typestore

from agribot.core.errors import BridgeError
from agribot.ros.display_requests import TakeDisplay
from agribot.ros.graph import Graph

OnBytes = Callable[[str, bytes], None]  # a message's type and bytes, in a thread of the network


class OpenTopic(Protocol):
    """A topic that is heard until it is closed."""

    def close(self) -> None: ...


class TopicNetwork(Protocol):
    """One network. One thread at a time may call."""

    is_ros2: bool

    def read_graph(self) -> Graph:
        """Read who publishes and who listens.

        Raises: BridgeError: the network cannot be reached.
        """
        ...

    def open_topic(self, name: str, on_bytes: OnBytes) -> OpenTopic | None:
        """Hear a topic; None where no node publishes it yet.

        Raises: BridgeError: the network cannot be reached.
        """
        ...

    def take_texts(self, name: str, on_bytes: OnBytes) -> OpenTopic:
        """Hear a topic of std_msgs/String, and announce that we do.

        Raises: BridgeError: the network cannot be reached.
        """
        ...

    def serve_displays(self, take: TakeDisplay) -> None:
        """Serve AddMapvizDisplay until the network is closed.

        Raises: BridgeError: the network cannot be reached.
        """
        ...

    def close(self) -> None: ...


def check_definition(types: Typestore, name: str, ros_type: str, type_hash: str, node: str) -> None:
    """Check that `types` has the type of a topic as `node` defines it; no hash says nothing.

    Raises: BridgeError: the type is not known, or is another one.
    """
    if ros_type not in types.fielddefs:
        raise BridgeError(f"{name}: the type {ros_type} is unknown; use one of ROS 2 Jazzy")
    if type_hash and type_hash != types.hash_rihs01(ros_type):
        raise BridgeError(
            f"{name}: {ros_type} of {node} has another definition than in ROS 2 Jazzy; build it "
            "anew"
        )
