"""The noise of the simulator's sensors over DDS: the parameters of a node of their own."""

from __future__ import annotations

from collections.abc import Callable

from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.dds.node import DdsNode
from agribot.ros.dds.service_server import DdsServiceServer
from agribot.ros.ros2.noise_server import serve_noise
from agribot.ros.sensor_noise import NODE, SensorNoise


class DdsNoiseServer:
    """A node `/agribot_sensors` with a parameter SENSOR.PARAMETER for each.

    Raises: BridgeError: cyclonedds is not installed, or the domain cannot be joined.
    """

    def __init__(self, noise: SensorNoise, refuse: Callable[[str], None], domain: int) -> None:
        self._node = DdsNode(NODE, domain)
        self._server = DdsServiceServer(self._node, refuse)
        serve_noise(self._server, noise)
        self._node.announce()

    def publish(self, topic: Topic, data: bytes, t_ns: int) -> None:
        """Publish nothing: sensors are the gateway's."""

    def step(self, record: TickRecord) -> None:
        """Do nothing."""

    def close(self) -> None:
        self._server.close()
        self._node.close()
