"""The noise of the simulator's sensors over ROS 2: the parameters of a node of their own."""

from __future__ import annotations

from collections.abc import Callable

from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.ros2.node import ROUTER, Ros2Node
from agribot.ros.ros2.parameters import ParameterServer
from agribot.ros.ros2.service_server import ServiceServer
from agribot.ros.ros2.serving import ServingNode
from agribot.ros.sensor_noise import NODE, PARAMETERS, SensorNoise, describe
from agribot.sim.sensors.tuning import SENSORS, find_range


class Ros2NoiseServer:
    """A node `/agribot_sensors` with a parameter SENSOR.PARAMETER for each.

    Raises: BridgeError: zenoh is not installed, or no router can be reached.
    """

    def __init__(
        self,
        noise: SensorNoise,
        refuse: Callable[[str], None],
        *,
        domain: int = 0,
        router: str = ROUTER,
    ) -> None:
        self._node = Ros2Node(NODE, domain, router, listen=True)
        serve_noise(ServiceServer(self._node, refuse), noise)

    def publish(self, topic: Topic, data: bytes, t_ns: int) -> None:
        """Publish nothing: sensors are the gateway's."""

    def step(self, record: TickRecord) -> None:
        """Do nothing."""

    def close(self) -> None:
        self._node.close()


def serve_noise(node: ServingNode, noise: SensorNoise) -> None:
    """Serve the noise as parameters, and follow what others change."""
    keys = {f"{sensor}.{name}": (sensor, name) for sensor in SENSORS for name in PARAMETERS}

    def change(key: str, value: float) -> str:
        return noise.change(*keys[key], value, node.source)

    server = ParameterServer(
        node,
        NODE,
        {"use_sim_time": True}
        | {key: noise.read(sensor)[name] for key, (sensor, name) in keys.items()},
        frozenset(keys),
        change,
        about={key: describe(*at) for key, at in keys.items()},
        ranges={key: find_range(*at) for key, at in keys.items()},
    )
    noise.listen(lambda sensor, name, value: server.update(f"{sensor}.{name}", value))
