"""A sensor of the robot that is somebody else's topic."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import msgspec

from agribot.core.errors import BridgeError
from agribot.core.platform import Sensor
from agribot.ros.messages.sensor_readers import Read, Sample, seconds
from agribot.ros.messages.stamp_clock import StampClock, TickClock

QUEUE_MESSAGES = 1000  # not taken yet; a flood loses its oldest


class Ear(Protocol):
    """A network on which a topic can be heard without knowing its type beforehand."""

    def hear_any(self, name: str, heard: Callable[[str, bytes], None]) -> None:
        """`heard` gets the message type and its bytes, in a thread of the network."""
        ...

    def decode(self, ros_type: str, data: bytes) -> Any:
        """Raises: BridgeError: these bytes are no such message."""
        ...


class _Arrival(NamedTuple):
    stamp_s: float
    arrived_s: float  # by the monotonic clock
    sample: Sample


class TopicSource:
    """Messages are read in the network's thread and taken, with their time, in the loop's.

    `name` is the topic's; `refuse` hears what is not taken and why; `now_s` is the monotonic clock.
    A loop that makes up for lost time finds every sample in the tick in which it was captured.
    Raises: BridgeError: the network cannot be reached.
    """

    def __init__(
        self,
        sensor: Sensor,
        name: str,
        ear: Ear,
        readers: Mapping[str, Read],
        refuse: Callable[[str], None],
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.sensor, self.name = sensor, name
        self._ear, self._readers, self._refuse, self._now_s = ear, readers, refuse, now_s
        self._arrived: deque[_Arrival] = deque(maxlen=QUEUE_MESSAGES)
        self._ticks, self._clock = TickClock(), StampClock()
        self._timed: deque[tuple[float, Sample]] = deque(maxlen=QUEUE_MESSAGES)  # by capture time
        self._last_s = -1.0
        ear.hear_any(name, self._hear)

    def take(self, t_s: float) -> tuple[Sample, ...]:
        """Those captured until `t_s`; later ones of the same or an earlier time are left out."""
        self._ticks.tick(t_s, self._now_s())
        arrivals = [self._arrived.popleft() for _ in range(len(self._arrived))]
        for stamp_s, arrived_s, _ in arrivals:
            self._clock.hear(stamp_s, self._ticks.t_s(arrived_s))
        for stamp_s, arrived_s, sample in arrivals:
            at_s = self._clock.t_s(stamp_s, self._ticks.t_s(arrived_s))
            if at_s > self._last_s:
                self._last_s = at_s
                self._timed.append((at_s, sample))
        taken = []
        while self._timed and self._timed[0][0] <= t_s:
            at_s, sample = self._timed.popleft()
            taken.append(msgspec.structs.replace(sample, t_s=at_s))
        return tuple(taken)

    def close(self) -> None:
        """What the ear has declared goes with it."""

    def _hear(self, ros_type: str, data: bytes) -> None:
        arrived_s = self._now_s()
        read = self._readers.get(ros_type)
        try:
            if read is None:
                raise BridgeError(f"{ros_type} is none of {', '.join(self._readers)}")
            message = self._ear.decode(ros_type, data)
            sample = read(message, 0.0)
        except BridgeError as error:
            self._refuse(f"{self.sensor} from {self.name}: {error}")
            return
        if sample is not None:
            self._arrived.append(_Arrival(seconds(message.header.stamp), arrived_s, sample))
