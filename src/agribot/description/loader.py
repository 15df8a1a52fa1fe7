"""Robot descriptions: from a name or a file to a RobotSpec."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

from agribot.core.errors import DescriptionError
from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import Link, RobotSpec
from agribot.description import devices
from agribot.description.adopt_devices import adopt_devices
from agribot.description.adopt_wheels import adopt_base, adopt_wheels, name_apart
from agribot.description.elements import Finding, Source
from agribot.description.expansion import expand
from agribot.description.implements import read_implement
from agribot.description.kinematics import read_joints, read_links
from agribot.description.markup import parse_xml
from agribot.description.package import packaged_or_file, robot_files

# Of the wheels together: what is lighter was forgotten, and no physics can stand on it.
MIN_BODY_RATIO = 0.05


def load_robot(
    name_or_path: str = "agribot", mappings: Mapping[str, str] | None = None
) -> RobotSpec:
    """Read a packaged robot, or a .xacro or .urdf file.

    `mappings` are values for the file's xacro arguments, such as {"legacy_camera": "true"}.
    Robots of other makers get our names for their wheels and usual values for what their
    description leaves out; `warnings` says which.

    Raises: DescriptionError: unknown name, broken file, or no four wheels to drive with.
    """
    return _read(*_opened(name_or_path, mappings or {}))


def parse_robot(urdf: str, source_name: str) -> RobotSpec:
    """Read plain URDF text, as a recording holds it; errors name `source_name`."""
    return _read(parse_xml(urdf, source_name), Source(source_name), Path(source_name))


def check_robot(name_or_path: str = "agribot") -> tuple[Finding, ...]:
    """Everything that is wrong or left out in a description, in the order of its lines.

    Raises: DescriptionError: unknown name, or no such file.
    """
    path = _robot_path(name_or_path)
    if not path.is_file():
        raise DescriptionError(f"robot file {path} does not exist; check the path")
    source = Source(path.name, collecting=True)
    try:
        _read(expand(path, {}, source), source, path)
    except DescriptionError as error:
        source.note(error)
    return tuple(sorted(dict.fromkeys(source.findings), key=lambda f: (f.file, f.line)))


def urdf_text(name_or_path: str = "agribot", mappings: Mapping[str, str] | None = None) -> str:
    """The expanded description as URDF text; the same bytes on every machine."""
    root, source, path = _opened(name_or_path, mappings or {})
    _adopt(root, source, path.parent)
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _opened(name_or_path: str, mappings: Mapping[str, str]) -> tuple[ET.Element, Source, Path]:
    path = _robot_path(name_or_path)
    source = Source(path.name)
    return expand(path, mappings, source), source, path


def _adopt(root: ET.Element, source: Source, folder: Path) -> None:
    """Complete the tree in place, so that it is a robot as the rest of AGRIBOT knows them."""
    name_apart(root, source)
    adopt_base(root, read_joints(root, source), source)
    adopt_wheels(root, read_links(root, source), read_joints(root, source), source, folder)
    adopt_devices(root, read_links(root, source), read_joints(root, source), source)


def _read(root: ET.Element, source: Source, path: Path) -> RobotSpec:
    _adopt(root, source, path.parent)
    links = read_links(root, source)
    joints = read_joints(root, source)
    _check_masses(links, source)
    drive = devices.read_drive(root, links, joints, source)
    imu, gnss, mag = devices.read_mounts(root, links, source)
    return RobotSpec(
        name=root.get("name", path.stem),
        links=links,
        joints=joints,
        drive=drive,
        tyre=devices.read_tyre(root, joints, source),
        imu=imu,
        gnss=gnss,
        mag=mag,
        camera=devices.read_camera(root, links, source),
        implement=read_implement(root, source),
        warnings=source.warnings(),
    )


def _check_masses(links: Sequence[Link], source: Source) -> None:
    """Every wheel and the rest of the robot need a mass, and none may be negative."""
    wheels = {link.name: link.mass_kg for link in links if link.name in WHEEL_NAMES}
    bodies = {**wheels, "base_link": sum(link.mass_kg for link in links if link.name not in wheels)}
    for name, mass_kg in {**{link.name: link.mass_kg for link in links}, **bodies}.items():
        if mass_kg < 0.0 or (name in bodies and mass_kg == 0.0):
            raise source.fail(
                f"link '{name}'", f"a mass of {mass_kg:g} kg; give its <inertial> one above 0"
            )
    body_kg, wheels_kg = bodies["base_link"], sum(wheels.values())
    if body_kg < MIN_BODY_RATIO * wheels_kg:
        raise source.fail(
            "link 'base_link'",
            f"{body_kg:g} kg with all that it carries, between wheels of {wheels_kg:g} kg; give "
            f"its <inertial> at least {MIN_BODY_RATIO * wheels_kg:g} kg",
        )


def _robot_path(name_or_path: str) -> Path:
    return packaged_or_file("robot", name_or_path, robot_files(), (".xacro", ".urdf"))
