"""The noise of the simulator's sensors over ROS 1: parameters, and dynamic_reconfigure's service.

The names are those of the original's sensor plugins: a group beside the topic of each sensor.
"""

from __future__ import annotations

import functools
import threading

from agribot.core.errors import BridgeError
from agribot.core.messages import TickRecord
from agribot.core.topics import FIX, IMU, MAGNETIC, Topic
from agribot.ros.ros1.master import MASTER
from agribot.ros.ros1.node import Node, Publication
from agribot.ros.ros1.reconfigure_types import (
    CONFIG,
    DESCRIPTION,
    SET_PARAMETERS,
    encode,
    load_reconfigure_types,
    make_config,
    make_description,
    read_config,
)
from agribot.ros.ros1.service_server import Ros1ServiceServer
from agribot.ros.sensor_noise import NODE, PARAMETERS, SensorNoise, describe
from agribot.sim.sensors.tuning import NEUTRAL, find_range

# Sensor -> the group of its parameters.
GROUPS = {
    "gnss": f"{FIX.seed_alias}/position",
    "gnss_velocity": f"{FIX.seed_alias}/velocity",
    "accel": f"{IMU.seed_alias}/accel",
    "gyro": f"{IMU.seed_alias}/rate",
    "mag": MAGNETIC.seed_alias,
}


class Ros1NoiseServer:
    """A node with the parameters of all sensors: `rosparam set` and `set_parameters` change them.

    A value that is refused is put back on the master, and the reason is reported.
    Raises: BridgeError: no master answers.
    """

    def __init__(self, noise: SensorNoise, master_uri: str = MASTER, namespace: str = "") -> None:
        self._noise = noise
        self._node = Node(NODE, master_uri, namespace=namespace)
        self._services = Ros1ServiceServer(self._node, lambda _text: None)
        self._lock = threading.Lock()
        self._updates: dict[str, Publication] = {}
        try:
            for sensor, group in GROUPS.items():
                self._open_group(sensor, group)
        except BridgeError:
            self.close()
            raise
        noise.listen(self._on_change)

    def publish(self, topic: Topic, data: bytes, t_ns: int) -> None:
        """Publish nothing: sensors are the gateway's."""

    def step(self, record: TickRecord) -> None:
        """Do nothing."""

    def close(self) -> None:
        self._services.close()
        self._node.close()

    def _open_group(self, sensor: str, group: str) -> None:
        values = self._noise.read(sensor)
        for name in PARAMETERS:
            self._node.set_param(f"{group}/{name}", values[name])
            self._node.subscribe_param(
                f"{group}/{name}",
                functools.partial(self._on_param, sensor, name),
            )
        description = make_description(
            {name: describe(sensor, name) for name in PARAMETERS},
            {name: find_range(sensor, name) for name in PARAMETERS},
            NEUTRAL,
        )
        about = self._advertise(f"{group}/parameter_descriptions", DESCRIPTION)
        about.put(encode(description))
        self._updates[sensor] = self._advertise(f"{group}/parameter_updates", CONFIG)
        self._updates[sensor].put(encode(make_config(values)))
        self._services.serve(
            f"{group}/set_parameters",
            SET_PARAMETERS,
            lambda request, source: self._on_request(sensor, request, source),
        )

    def _advertise(self, name: str, ros_type: str) -> Publication:
        return self._node.advertise(
            name, ros_type, latched=True, depth=1, types=load_reconfigure_types()
        )

    def _on_request(self, sensor: str, request: bytes, source: str) -> bytes:
        """Change what the request names, if all of it can be; answer with what now holds."""
        wanted = {name: value for name, value in read_config(request).items() if name in NEUTRAL}
        why = self._noise.change_all(sensor, wanted, source)
        if why:
            raise BridgeError(why)
        return encode(make_config(self._noise.read(sensor)))

    def _on_param(self, sensor: str, name: str, value: object) -> None:
        """Follow the master's parameter; put it back where the value cannot be."""
        if isinstance(value, dict):  # the whole group, with this one in it
            value = value.get(name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        why = (
            self._noise.change(sensor, name, float(value), "ROS 1: rosparam")  # type: ignore[arg-type]
            if is_number
            else self._noise.refuse(f"ROS 1: rosparam: {sensor} {name} must be a number")
        )
        if why:
            self._node.set_param(f"{GROUPS[sensor]}/{name}", self._noise.read(sensor)[name])

    def _on_change(self, sensor: str, name: str, value: float) -> None:
        """Report a change to the master and all listeners, whatever its source."""
        with self._lock:
            self._node.set_param(f"{GROUPS[sensor]}/{name}", value)
            self._updates[sensor].put(encode(make_config(self._noise.read(sensor))))
