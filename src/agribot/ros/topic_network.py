"""A network whose topics one can list, hear and leave again, whatever their types."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

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

    def close(self) -> None: ...
