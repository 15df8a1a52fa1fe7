"""A sensor of the robot that comes from a topic of another node."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from agribot.core.errors import BridgeError
from agribot.core.platform import Sensor
from agribot.core.stamp_clock import SampleQueue
from agribot.ros.messages.rosmsg import to_seconds
from agribot.ros.messages.sensor_readers import ReadSample, Sample


class UntypedConnection(Protocol):
    """A network on which one can subscribe to a topic of any type."""

    def subscribe_any(self, name: str, on_message: Callable[[str, bytes], None]) -> None:
        """Subscribe to a topic; `on_message` gets type and bytes in a thread of the network."""
        ...

    def decode(self, ros_type: str, data: bytes) -> Any:
        """Decode a message.

        Raises: BridgeError: the bytes are no such message.
        """
        ...


class TopicSource:
    """Reads messages in the network's thread; the loop takes them with their capture time.

    `name` is the topic's; `refuse` is called with the reason for each message that is rejected;
    `now_s` is the monotonic clock. A loop that catches up on lost time finds every sample in the
    tick in which it was captured.
    Raises: BridgeError: the network cannot be reached.
    """

    def __init__(
        self,
        sensor: Sensor,
        name: str,
        connection: UntypedConnection,
        readers: Mapping[str, ReadSample],
        refuse: Callable[[str], None],
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.sensor, self.name = sensor, name
        self._connection, self._readers, self._refuse = connection, readers, refuse
        self._arrivals: SampleQueue[Sample] = SampleQueue(now_s)
        connection.subscribe_any(name, self._on_message)

    def take(self, t_s: float) -> tuple[Sample, ...]:
        """Take the samples captured until `t_s`; one not newer than its predecessor is dropped."""
        return self._arrivals.take(t_s)

    def close(self) -> None:
        """Do nothing: the subscription ends with its connection."""

    def _on_message(self, ros_type: str, data: bytes) -> None:
        arrived_s = self._arrivals.now_s()
        read = self._readers.get(ros_type)
        try:
            if read is None:
                raise BridgeError(f"{ros_type} is not read; send {' or '.join(self._readers)}")
            message = self._connection.decode(ros_type, data)
            sample = read(message, 0.0)
        except BridgeError as error:
            self._refuse(f"{self.sensor} from {self.name}: {error}")
            return
        if sample is not None:
            self._arrivals.put(to_seconds(message.header.stamp), arrived_s, sample)
