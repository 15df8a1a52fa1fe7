"""What a node needs of a network: topics in, topics out, in CDR whatever is spoken outside."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from agribot.core.topics import Topic


class Link(Protocol):
    def hear(self, topic: Topic, heard: Callable[[bytes], None]) -> None:
        """`heard` gets each message from a thread of the network.

        Raises: BridgeError: the network cannot be reached.
        """
        ...

    def advertise(self, topic: Topic) -> None:
        """Raises: BridgeError: the network cannot be reached."""
        ...

    def publish(self, topic: Topic, data: bytes) -> None:
        """Of an advertised topic. Raises: BridgeError: the network was lost."""
        ...

    def close(self) -> None: ...
