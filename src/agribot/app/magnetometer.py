"""Whether a robot has a magnetometer: many have none, because motors disturb it."""

from __future__ import annotations

from agribot.core.config import RunConfig
from agribot.core.robot import RobotSpec


def has_magnetometer(robot: RobotSpec, config: RunConfig) -> bool:
    """Whether its description has one and, in a simulation, the sensor preset as well.

    Raises: ConfigError: there is no such preset.
    """
    if robot.mag is None:
        return False
    if config.platform == "hardware":
        return True
    from agribot.sim.sensors.presets import load_preset

    return load_preset(config.sim.sensors).mag != "none"
