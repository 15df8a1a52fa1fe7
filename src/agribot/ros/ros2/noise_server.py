"""The noise of the simulator's sensors over ROS 2: the parameters of a node of their own."""

from __future__ import annotations

from collections.abc import Callable

from agribot.core.messages import TickRecord
from agribot.core.topics import Topic
from agribot.ros.ros2.node import ROUTER, Ros2Node
from agribot.ros.ros2.parameters import ParameterServer
from agribot.ros.ros2.service_server import ServiceServer
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
        names = [f"{sensor}.{parameter}" for sensor in SENSORS for parameter in PARAMETERS]
        values = {name: noise.read(name.split(".")[0])[name.split(".")[1]] for name in names}
        self._server = ParameterServer(
            ServiceServer(self._node, refuse),
            NODE,
            {"use_sim_time": True, **values},
            frozenset(names),
            lambda name, value: noise.change(*name.split("."), value, "ROS 2"),
            about={name: describe(*name.split(".")) for name in names},
            ranges={name: find_range(*name.split(".")) for name in names},
        )
        noise.listen(
            lambda sensor, parameter, value: self._server.update(f"{sensor}.{parameter}", value)
        )

    def publish(self, topic: Topic, data: bytes, t_ns: int) -> None:
        """Publish nothing: sensors are the gateway's."""

    def step(self, record: TickRecord) -> None:
        """Do nothing."""

    def close(self) -> None:
        self._node.close()
