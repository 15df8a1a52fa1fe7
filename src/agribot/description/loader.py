"""Robot descriptions: from a name or a file to a RobotSpec."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from agribot.core.errors import DescriptionError
from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import DriveSpec, Link, RobotSpec
from agribot.description import devices
from agribot.description.adopt_devices import adopt_devices
from agribot.description.adopt_wheels import (
    adopt_base,
    adopt_wheels,
    list_middle_wheels,
    make_names_unique,
    warn_of_loose_links,
)
from agribot.description.elements import FileFinding, SourceFile
from agribot.description.expansion import expand, is_sdf
from agribot.description.fixture import (
    FixtureSpec,
    is_fixture,
    read_fixture,
    refuse_fixture,
)
from agribot.description.implements import read_implement
from agribot.description.kinematics import read_joints, read_links
from agribot.description.lidar import read_lidar
from agribot.description.markup import parse_xml
from agribot.description.package import (
    find_packaged_or_file,
    list_fixture_files,
    list_robot_files,
    split_arguments,
)
from agribot.description.poses import warn_of_large_angles
from agribot.description.sdf_robot import read_sdf_robot
from agribot.description.sensor_places import place_sensors, warn_of_turned_sensors, warn_of_unread

SDF, WORLD = ".sdf", ".world"
# Least mass of the body, as a share of the wheels together: a lighter one lacks its mass, and its
# physics would be unstable.
MIN_BODY_RATIO = 0.05
MOST_KG_PER_M2 = 3000.0  # mass over the ground under it; a tractor has 1500, a tank 2500


def load_robot(
    name_or_path: str = "agribot", mappings: Mapping[str, str] | None = None
) -> RobotSpec:
    """Read a packaged robot, or a .xacro, .urdf or .sdf file.

    `mappings` are values for the file's xacro arguments, such as {"legacy_camera": "true"}; they
    may also follow the name, as in "agribot legacy_camera:=true".
    Robots of other makers get our names for their wheels and default values for missing parts;
    `warnings` lists them.

    Raises: DescriptionError: unknown name, broken file, or no four wheels to drive with.
    """
    return _read_robot(*_open_source(name_or_path, mappings or {}))


def parse_robot(urdf: str, source_name: str) -> RobotSpec:
    """Read plain URDF text, such as a recording's; errors name `source_name`."""
    return _read_robot(parse_xml(urdf, source_name), SourceFile(source_name), Path(source_name))


def check_robot(name_or_path: str = "agribot") -> tuple[FileFinding, ...]:
    """List all errors and gaps of a description, in the order of its lines.

    Raises: DescriptionError: unknown name, or no such file.
    """
    name, mappings = split_arguments(name_or_path)
    path = _find_robot_file(name)
    if not path.is_file():
        raise DescriptionError(f"robot file {path} does not exist; check the path")
    source = SourceFile(path.name, collecting=True)
    try:
        root = _read_tree(path, mappings, source)
        if is_fixture(root, source):
            read_fixture(root, source)
        else:
            _read_robot(root, source, path)
    except DescriptionError as error:
        source.note(error)
    return tuple(sorted(dict.fromkeys(source.findings), key=lambda f: (f.file, f.line)))


def load_fixture(name_or_path: str) -> FixtureSpec | None:
    """Read what stands, such as a pole with a receiver; None for a robot.

    Raises: DescriptionError: unknown name or broken file.
    """
    root, source, _ = _open_source(name_or_path, {})
    return read_fixture(root, source) if is_fixture(root, source) else None


def export_urdf(name_or_path: str = "agribot", mappings: Mapping[str, str] | None = None) -> str:
    """Expand a description to URDF text; the same bytes on every machine."""
    root, source, path = _open_source(name_or_path, mappings or {})
    if not is_fixture(root, source):
        _adopt(root, source, path.parent)
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _open_source(
    name_or_path: str, mappings: Mapping[str, str]
) -> tuple[ET.Element, SourceFile, Path]:
    name, written = split_arguments(name_or_path)
    path = _find_robot_file(name)
    source = SourceFile(path.name)
    return _read_tree(path, {**written, **mappings}, source), source, path


def _read_tree(path: Path, mappings: Mapping[str, str], source: SourceFile) -> ET.Element:
    """Read a file as a URDF tree; an SDF takes no arguments."""
    if not mappings and path.is_file() and is_sdf(path):
        return read_sdf_robot(path, source)
    return expand(path, mappings, source)


def _adopt(root: ET.Element, source: SourceFile, folder: Path) -> None:
    """Complete the tree in place with all links, names and tags that AGRIBOT needs."""
    make_names_unique(root, source)
    adopt_base(root, read_joints(root, source), source)
    warn_of_unread(root, source)
    place_sensors(root, source)
    warn_of_loose_links(root, read_joints(root, source), source)
    adopt_wheels(root, read_links(root, source), read_joints(root, source), source, folder)
    adopt_devices(root, read_links(root, source), read_joints(root, source), source)


def _read_robot(root: ET.Element, source: SourceFile, path: Path) -> RobotSpec:
    refuse_fixture(root, source)
    warn_of_large_angles(root, source)
    _adopt(root, source, path.parent)
    links = read_links(root, source)
    joints = read_joints(root, source)
    _check_masses(links, list_middle_wheels(joints), source)
    drive = devices.read_drive(root, links, joints, source)
    _check_weight(links, drive, source)
    imu, gnss, mag = devices.read_mounts(root, links, source)
    robot = RobotSpec(
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
        lidar=read_lidar(root, links, source),
        middle_wheels=list_middle_wheels(joints),
    )
    warn_of_turned_sensors(robot, source)
    return msgspec.structs.replace(robot, warnings=source.list_warnings())


def _check_masses(links: Sequence[Link], middle_wheels: Sequence[str], source: SourceFile) -> None:
    """Check that every wheel and the rest of the robot have a mass, and none is negative."""
    wheel_names = (*WHEEL_NAMES, *middle_wheels)
    wheels = {link.name: link.mass_kg for link in links if link.name in wheel_names}
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


def _check_weight(links: Sequence[Link], drive: DriveSpec, source: SourceFile) -> None:
    """Check that the robot is no heavier than anything of its size can be."""
    mass_kg = sum(link.mass_kg for link in links)
    length_m = drive.wheelbase_m + 2.0 * drive.wheel_radius_m
    width_m = drive.track_m + drive.wheel_width_m
    most_kg = MOST_KG_PER_M2 * length_m * width_m
    if mass_kg > most_kg:
        heaviest = max(links, key=lambda link: link.mass_kg)
        raise source.fail(
            "the robot",
            f"a mass of {mass_kg:.6g} kg on {length_m:.2f} x {width_m:.2f} m, more than the limit "
            f"of {most_kg:.6g} kg for that size (link '{heaviest.name}' alone: "
            f"{heaviest.mass_kg:.6g} kg); masses are in kilograms, divide those in grams by 1000",
        )


def _find_robot_file(name_or_path: str) -> Path:
    if Path(name_or_path).suffix.lower() == WORLD:
        raise DescriptionError(
            f"{name_or_path}: that is a world; give the robot's own URDF, xacro or .sdf"
        )
    if Path(name_or_path).suffix.lower() == SDF:
        return Path(name_or_path)
    known = list_robot_files() | list_fixture_files()
    return find_packaged_or_file("robot", name_or_path, known, (".xacro", ".urdf"))
