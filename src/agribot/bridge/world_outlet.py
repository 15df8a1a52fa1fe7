"""The tap behind the bridges of a world without a robot's mind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from agribot import topics
from agribot.bridge.outlet import QUEUE_TICKS, Gateway
from agribot.bridge.send_queue import SendQueue
from agribot.errors import BridgeError
from agribot.messages import DriveCommand, SensorBatch
from agribot.robot import RobotSpec
from agribot.ros import cdr
from agribot.ros.camera_log import CameraLog
from agribot.ros.rosmsg import nanoseconds
from agribot.ros.world_feed import WorldFeed
from agribot.topic import Topic


class _Item(NamedTuple):
    batch: SensorBatch
    command: DriveCommand | None
    pose: tuple[float, float, float]
    twist: tuple[float, float]


class WorldOutlet:
    """Call it once per tick, as a WorldFeed; it never waits for a peer."""

    def __init__(
        self, gateways: Sequence[Gateway], robot: RobotSpec, urdf: str, camera: CameraLog
    ) -> None:
        self._gateways = tuple(gateways)
        self._feed = WorldFeed(self._send, robot, urdf, camera)
        self._clock = cdr.ClockCdr()
        self._queue = SendQueue(self._step, QUEUE_TICKS)
        self.fault = ""

    @property
    def dropped(self) -> int:
        return self._queue.dropped

    def __call__(
        self,
        batch: SensorBatch,
        command: DriveCommand | None,
        pose: tuple[float, float, float],
        twist: tuple[float, float],
    ) -> None:
        """`pose` is the true x_map_m, y_map_m, yaw_map_rad, `twist` the forward and yaw rate."""
        self._queue.put(_Item(batch, command, pose, twist))

    def close(self) -> None:
        if self._queue.close():
            for gateway in self._gateways:
                gateway.close()

    def _step(self, item: _Item) -> None:
        self._feed(*item)
        t_ns = nanoseconds(item.batch.t_s)
        self._send(topics.CLOCK, t_ns, self._clock(t_ns), t_ns)

    def _send(self, topic: Topic, log_ns: int, data: bytes, _publish_ns: int) -> None:
        for gateway in self._gateways:
            try:
                gateway.publish(topic, data, log_ns)
            except BridgeError as error:
                self.fault = str(error)
