"""Robot descriptions: from a name or a file to a RobotSpec."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from agribot.description import devices
from agribot.description.elements import Source
from agribot.description.expansion import expand
from agribot.description.kinematics import read_joints, read_links
from agribot.description.package import robot_files
from agribot.errors import DescriptionError
from agribot.robot import RobotSpec


def load_robot(
    name_or_path: str = "agribot", mappings: Mapping[str, str] | None = None
) -> RobotSpec:
    """Read a packaged robot, or a .xacro or .urdf file.

    `mappings` are values for the file's xacro arguments, such as {"legacy_camera": "true"}.

    Raises: DescriptionError: unknown name, broken file, or a part without which the robot
        cannot be driven: wheels, drive, IMU, GNSS receiver or magnetometer.
    """
    path = _robot_path(name_or_path)
    return _read(expand(path, mappings or {}), Source(path.name), path.stem)


def parse_robot(urdf: str, source_name: str) -> RobotSpec:
    """Read plain URDF text, as a recording holds it; errors name `source_name`."""
    return _read(ET.fromstring(urdf), Source(source_name), source_name)


def _read(root: ET.Element, source: Source, default_name: str) -> RobotSpec:
    links = read_links(root, source)
    joints = read_joints(root, source)
    if not any(link.name == "base_link" for link in links):
        names = ", ".join(link.name for link in links) or "none"
        raise source.fail("links", f"'base_link' is missing; there are: {names}")
    drive = devices.read_drive(root, links, joints, source)
    imu, gnss, mag = devices.read_mounts(root, links, source)
    return RobotSpec(
        name=root.get("name", default_name),
        links=links,
        joints=joints,
        drive=drive,
        tyre=devices.read_tyre(root, joints, source),
        imu=imu,
        gnss=gnss,
        mag=mag,
        camera=devices.read_camera(root, links, source),
        sprayer=devices.read_sprayer(root, source),
    )


def urdf_text(name_or_path: str = "agribot", mappings: Mapping[str, str] | None = None) -> str:
    """The expanded description as URDF text; the same bytes on every machine."""
    root = expand(_robot_path(name_or_path), mappings or {})
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _robot_path(name_or_path: str) -> Path:
    known = robot_files()
    if name_or_path in known:
        return known[name_or_path]
    path = Path(name_or_path)
    if path.suffix in {".xacro", ".urdf"}:
        return path
    raise DescriptionError(
        f"unknown robot '{name_or_path}'; known: {', '.join(sorted(known))}, "
        "or a path to a .xacro or .urdf file"
    )
