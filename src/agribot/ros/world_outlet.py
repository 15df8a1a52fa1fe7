"""The tap behind the bridges of a world without a robot's mind."""

from __future__ import annotations

from collections.abc import Sequence

from agribot.core.robot import RobotSpec
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.world_feed import WorldFeed, WorldTick
from agribot.ros.outlet import Gateway, QueuedGateways


class WorldOutlet(QueuedGateways[WorldTick]):
    """Call it once per tick, as a WorldFeed; it never waits for a peer."""

    def __init__(
        self, gateways: Sequence[Gateway], robot: RobotSpec, urdf: str, camera: CameraLog
    ) -> None:
        super().__init__(gateways)
        self._feed = WorldFeed(self._gateways.send, robot, urdf, camera)

    def __call__(self, tick: WorldTick) -> None:
        self._queue.put(tick)

    def _step(self, tick: WorldTick) -> None:
        self._feed(tick)
        self._gateways.tell_time(tick.batch.t_s)
