"""Sensors of a robot: one with a pose of its own gets a link there, one that is not read a name."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec
from agribot.description.adopt_masses import format_numbers
from agribot.description.elements import SourceFile
from agribot.description.poses import read_pose, to_origin
from agribot.description.tags import (
    DRIVE_PLUGINS,
    GNSS,
    IMU,
    MAG,
    iterate_gazebo_blocks,
)

# Types of sensors that are read, and how many of each a robot has.
READ = {
    "camera": "camera", "imu": "IMU", "gps": "GNSS receiver", "navsat": "GNSS receiver",
    "magnetometer": "magnetometer", "ray": "lidar", "gpu_ray": "lidar", "lidar": "lidar",
    "gpu_lidar": "lidar",
}  # fmt: skip
OFFSET_TAGS = ("xyzoffset", "rpyoffset")
# Plugins whose work is done here otherwise.
READ_PLUGINS = (
    *DRIVE_PLUGINS, *IMU.plugins, *GNSS.plugins, *MAG.plugins, "camera", "control",
    "laser", "ray_sensor",
    "joint_state", "joint-state", "pose-publisher", "odometry-publisher", "p3d", "ground_truth",
)  # fmt: skip
TURNED_RAD = 0.01  # angle beyond the accuracy of a mount's description


def place_sensors(root: ET.Element, source: SourceFile) -> None:
    """Give each sensor with a <pose> a link at that pose, in place of the one that carries it.

    Raises: DescriptionError: the pose cannot be read.
    """
    for link, block in list(iterate_gazebo_blocks(root)):
        for sensor in block.findall("sensor"):
            if sensor.get("type", "").lower() in READ:
                with source.attempt(sensor):
                    link_from_sensor = _take_pose(sensor, link, source)
                    if not np.allclose(link_from_sensor, np.eye(4), atol=1e-9):
                        block.remove(sensor)
                        _hang(root, link, sensor, link_from_sensor)


def _take_pose(sensor: ET.Element, link: str, source: SourceFile) -> FloatArray:
    """Remove the pose of a sensor, and that of its camera; return `link_from_sensor`, (4, 4)."""
    where, matrix = f"sensor '{sensor.get('name', '')}'", np.eye(4)
    for element in (sensor, *sensor.findall("camera")):
        pose = element.find("pose")
        if pose is None:
            continue
        relative = pose.get("relative_to", "") or pose.get("frame", "")  # SDF 1.6 names it so
        if relative not in {"", link}:
            raise source.fail(
                where,
                f"its <pose> is relative to '{relative}', which is not read here; state it in the "
                f"frame of '{link}'",
            )
        matrix = matrix @ read_pose(element, source, where)
        element.remove(pose)
    return matrix


def _hang(root: ET.Element, link: str, sensor: ET.Element, link_from_sensor: FloatArray) -> None:
    """Hang a sensor on a link of its own."""
    own = _choose_free_name(root, f"{link}_{sensor.get('name', 'sensor')}")
    origin = to_origin(link_from_sensor)
    ET.SubElement(root, "link", {"name": own})
    joint = ET.SubElement(root, "joint", {"name": f"{link}_to_{own}", "type": "fixed"})
    places = {"xyz": format_numbers(origin.xyz_m), "rpy": format_numbers(origin.rpy_rad)}
    ET.SubElement(joint, "origin", places)
    ET.SubElement(joint, "parent", {"link": link})
    ET.SubElement(joint, "child", {"link": own})
    ET.SubElement(root, "gazebo", {"reference": own}).append(sensor)


def _choose_free_name(root: ET.Element, name: str) -> str:
    taken = {link.get("name") for link in root.findall("link")}
    while name in taken:
        name += "_"
    return name


def warn_of_unread(root: ET.Element, source: SourceFile) -> None:
    """Name the sensors and plugins of a robot that are not read."""
    first: dict[str, str] = {}
    for _link, block in iterate_gazebo_blocks(root):
        for sensor in block.iter("sensor"):
            name, kind = sensor.get("name", ""), sensor.get("type", "").lower()
            what = READ.get(kind)
            if what is None:
                source.warn(f"sensor '{name}' of type '{kind}' is not simulated", sensor)
            elif first.setdefault(what, name) != name:
                source.warn(
                    f"{what} '{name}' is not simulated; '{first[what]}' is the robot's", sensor
                )
        for plugin in block.iter("plugin"):
            _warn_of_plugin(plugin, source)


def _warn_of_plugin(plugin: ET.Element, source: SourceFile) -> None:
    file = plugin.get("filename", "")
    words = f"{file} {plugin.get('name', '')}".lower()
    if not any(word in words for word in READ_PLUGINS):
        source.warn(f"plugin '{file}' is not read", plugin, quiet=True)
    for tag in plugin:
        numbers = (tag.text or "").split()
        if tag.tag.lower() in OFFSET_TAGS and any(number.strip("-+0.") for number in numbers):
            source.warn(f"plugin '{file}': <{tag.tag}> {tag.text} is not read", tag)


def warn_of_turned_sensors(robot: RobotSpec, source: SourceFile) -> None:
    """Name an IMU and a magnetometer whose axes are not the body's."""
    for what, mount in (("IMU", robot.imu), ("magnetometer", robot.mag)):
        if mount is None:
            continue
        turn = robot.base_from_link(mount.link)[:3, :3]
        turn_rad = float(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))
        if turn_rad > TURNED_RAD:
            source.warn(
                f"{what}: link '{mount.link}' is turned by {np.degrees(turn_rad):.0f} degrees; "
                "its readings are simulated and taken along the axes of the body"
            )
