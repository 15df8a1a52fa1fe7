"""The tap behind the bridges of a world without a robot's mind."""

from __future__ import annotations

from collections.abc import Sequence

from agribot.bridge.outlet import QUEUE_TICKS, Gateway, Gateways
from agribot.bridge.send_queue import SendQueue
from agribot.robot import RobotSpec
from agribot.ros.camera_log import CameraLog
from agribot.ros.world_feed import WorldFeed, WorldTick


class WorldOutlet:
    """Call it once per tick, as a WorldFeed; it never waits for a peer."""

    def __init__(
        self, gateways: Sequence[Gateway], robot: RobotSpec, urdf: str, camera: CameraLog
    ) -> None:
        self._gateways = Gateways(gateways)
        self._feed = WorldFeed(self._gateways.send, robot, urdf, camera)
        self._queue = SendQueue(self._step, QUEUE_TICKS)

    @property
    def dropped(self) -> int:
        return self._queue.dropped

    @property
    def fault(self) -> str:
        return self._gateways.fault

    def __call__(self, tick: WorldTick) -> None:
        self._queue.put(tick)

    def close(self) -> None:
        if self._queue.close():
            self._gateways.close()

    def _step(self, tick: WorldTick) -> None:
        self._feed(tick)
        self._gateways.tell_time(tick.batch.t_s)
