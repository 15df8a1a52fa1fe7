"""What a robot does as a node of ROS 1, of ROS 2 and on DDS alike: topics out, requests in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from agribot.core import topics
from agribot.core.errors import BridgeError
from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.requests import Requests, read_twist_cdr

Writer = Callable[[bytes], None]


class _Served(Protocol):
    """What the peers of a node ask of a running robot."""

    def step(self, record: TickRecord) -> None: ...

    def close(self) -> None: ...


class NodeGateway:
    """Publishes by the writers of each topic, by its name of ours; `source` names the network."""

    source: str

    def __init__(self, requests: Requests) -> None:
        self._requests = requests
        self._writers: Mapping[str, Sequence[Writer]] = {}
        self._robot: _Served | None = None

    def publish(self, topic: Topic, data: bytes, _t_ns: int) -> None:
        if self._requests.frames is not None:
            self._requests.frames.note(topic, data)
        for writer in self._writers.get(topic.name, ()):
            writer(data)

    def step(self, record: TickRecord) -> None:
        if self._robot is not None:
            self._robot.step(record)

    def close(self) -> None:
        if self._robot is not None:
            self._robot.close()

    def _take_twist(self, data: bytes) -> None:
        try:
            self._requests.request_twist(read_twist_cdr(data), self.source)
        except BridgeError as error:
            self._requests.refuse(f"{self.source}: {topics.CMD_VEL.name}: {error}")
