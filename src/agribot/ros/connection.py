"""A node's connection to a network: topics in and out, in CDR whatever the network's encoding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from agribot.core.topics import Topic


class TopicConnection(Protocol):
    """Publishes and subscribes to topics of the table."""

    def subscribe(self, topic: Topic, on_message: Callable[[bytes], None]) -> None:
        """Subscribe to a topic; a thread of the network calls `on_message` with each message.

        Raises: BridgeError: the network cannot be reached.
        """
        ...

    def advertise(self, topic: Topic) -> None:
        """Announce a topic before its first message.

        Raises: BridgeError: the network cannot be reached.
        """
        ...

    def publish(self, topic: Topic, data: bytes) -> None:
        """Publish a message of an advertised topic.

        Raises: BridgeError: the network was lost.
        """
        ...

    def close(self) -> None: ...
