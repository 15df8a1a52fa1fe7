"""The tap that publishes a simulated world without a stack."""

from __future__ import annotations

from collections.abc import Sequence

from agribot.core.config import EstimateConfig
from agribot.core.robot import RobotSpec
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.world_topic_writer import WorldTick, WorldTopicWriter
from agribot.ros.tick_publisher import Gateway, QueuedGateways


class WorldPublisher(QueuedGateways[WorldTick]):
    """Call it once per tick; it never waits for a peer."""

    def __init__(
        self,
        gateways: Sequence[Gateway],
        robot: RobotSpec,
        urdf: str,
        camera: CameraLog,
        wheels: EstimateConfig | None = None,
        *,
        has_map: bool = False,
    ) -> None:
        """Publish to all `gateways`; the rest is as in `WorldTopicWriter`."""
        super().__init__(gateways)
        self._feed = WorldTopicWriter(
            self._gateways.send, robot, urdf, camera, wheels, has_map=has_map
        )

    def __call__(self, tick: WorldTick) -> None:
        self._queue.put(tick)

    def _step(self, tick: WorldTick) -> None:
        self._feed(tick)
        self._gateways.publish_time(tick.batch.t_s)
