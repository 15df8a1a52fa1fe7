"""The noise of a simulator's sensors for peers, who change it while it runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from agribot.ros.sensor_noise import TunedSimulator
    from agribot.ros.tick_publisher import Gateway


def open_noise_servers(
    simulator: TunedSimulator,
    report: Callable[[str], None],
    *,
    is_open: bool,
    ros1: tuple[str, str] | None,
    ros2: tuple[int, str] | None,
    dds: int | None,
) -> list[Gateway]:
    """Open a server in each network that is given.

    That is the master and the namespace of ROS 1, domain and router of ROS 2, and the domain of
    DDS. Only where `is_open` may peers change anything. Raises: BridgeError: a peer is missing.
    """
    from agribot.ros.sensor_noise import NODE, SensorNoise

    servers: list[Gateway] = []
    if ros1 is None and ros2 is None and dds is None:
        return servers
    noise = SensorNoise(simulator, is_open=is_open, report=report)
    try:
        if ros2 is not None:
            from agribot.ros.ros2.noise_server import Ros2NoiseServer

            domain, router = ros2
            servers.append(Ros2NoiseServer(noise, report, domain=domain, router=router))
        if dds is not None:
            from agribot.ros.dds.noise_server import DdsNoiseServer

            servers.append(DdsNoiseServer(noise, report, dds))
        if ros1 is not None:
            from agribot.ros.ros1.noise_server import Ros1NoiseServer

            master, namespace = ros1
            servers.append(Ros1NoiseServer(noise, master, namespace))
    except BaseException:
        for server in servers:
            server.close()
        raise
    report(f"node /{NODE}: the noise of the simulated sensors as parameters")
    return servers
