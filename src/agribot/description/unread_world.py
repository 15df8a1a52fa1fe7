"""What a world or a model holds that is not simulated, by its name."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from agribot.description.elements import SourceFile

BASE_SENSORS = ("gps", "navsat")  # sensors of a base station
# World plugins whose work is done here otherwise.
READ_PLUGINS = (
    "physics", "user-commands", "user_commands", "scene-broadcaster", "sensors-system",
    "imu-system", "navsat-system", "magnetometer-system", "contact-system", "gazebo_ros_init",
    "gazebo_ros_factory", "gazebo_ros_api",
)  # fmt: skip


def warn_of_unread_parts(model: ET.Element, name: str, source: SourceFile) -> None:
    """Name the sensors and the moving joints of a model, which stands still."""
    for sensor in model.iter("sensor"):
        kind = sensor.get("type", "").lower()
        if kind not in BASE_SENSORS:
            source.warn(
                f"model '{name}': sensor '{sensor.get('name', '')}' of type '{kind}' is not "
                "simulated",
                sensor,
            )
    moving = [joint for joint in model.iter("joint") if joint.get("type", "fixed") != "fixed"]
    if moving:
        names = ", ".join(f"'{joint.get('name', '')}'" for joint in moving)
        source.warn(
            f"model '{name}' stands still; its joints are not simulated: {names}", moving[0]
        )


def warn_of_unread_systems(world: ET.Element, source: SourceFile) -> None:
    """Name the wind and the plugins of a world."""
    for wind in world.findall("wind/linear_velocity"):
        if any(number.strip("-+0.") for number in (wind.text or "").split()):
            source.warn(f"<wind> of {wind.text} m/s is not simulated", wind)
    for plugin in world.findall("plugin"):
        file = plugin.get("filename", "")
        if not any(word in file.lower() for word in READ_PLUGINS):
            source.warn(f"plugin '{file}' is not read", plugin, quiet=True)
