"""What a robot drives with: skid steer on four to eight wheels, or a refusal by its name."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from agribot.core.messages import MIDDLE_WHEEL_NAMES, WHEEL_NAMES, FloatArray
from agribot.core.robot import Joint
from agribot.description.elements import SourceFile
from agribot.description.tags import (
    DRIVE_PLUGINS,
    find_plugin,
    iterate_gazebo_blocks,
    read_tag_value,
)

ACROSS = 0.7  # share of an axle that lies across the robot
ALONG = 0.3  # share of an axle along the robot above which its wheel goes aside
UPRIGHT = 0.7  # share of a steering joint's axis that is vertical
# Share of a first direction of friction along and across the axle, above which it is a roller's.
OBLIQUE = 0.3
ROLLERS = 3  # turning links on one wheel that make it one with rollers
TURNING = ("continuous", "revolute")
CASTOR_WORDS = ("caster", "castor", "swivel")
SIDEWAYS_WORDS = ("mecanum", "omni")
# Words in the file or the name of a plugin, by what such a one does.
OTHER_DRIVES = {
    "steers wheels": ("ackermann", "tricycle", "bicycle", "four_wheel_steering"),
    "drives sideways": ("mecanum", "planar_move", "omni_drive", "omnidrive"),
    "drives tracks": ("tracked", "track_controller", "track-controller", "trackcontroller"),
}
ONLY = "only skid steer on four, six or eight driven wheels is simulated and controlled"
TO_TRY = (
    "to try it as one, make the joints of the others fixed and leave four wheels at the corners"
)


class Wheel(NamedTuple):
    """A turning link; `centre_m` and `axle`, (3,), are in base_link, the axle about leftwards."""

    joint: Joint
    centre_m: FloatArray
    axle: FloatArray
    flipped: bool

    @property
    def names(self) -> str:
        return f"{self.joint.name} {self.joint.child}".lower()


def find_wheels(joints: Sequence[Joint], poses: Mapping[str, FloatArray]) -> list[Wheel]:
    """Find the links that turn about an axle across the robot; `poses` (4, 4) in base_link."""
    found = []
    for joint in joints:
        turns = joint.kind == "continuous" or (
            joint.kind == "revolute" and "wheel" in (joint.name + joint.child).lower()
        )
        if not turns or joint.child not in poses:
            continue
        axle = _turn_axis(joint, poses)
        if abs(axle[1]) > ACROSS:
            flipped = bool(axle[1] < 0.0)
            centre_m = poses[joint.child][:3, 3]
            found.append(Wheel(joint, centre_m, -axle if flipped else axle, flipped))
    return found


def _leave_named(wheels: Sequence[Wheel], source: SourceFile) -> Sequence[Wheel]:
    """Leave those that are called wheels, where they are four or more."""
    named = [wheel for wheel in wheels if "wheel" in wheel.names]
    if len(named) < len(WHEEL_NAMES):
        return wheels
    for other in wheels:
        if "wheel" not in other.names:
            source.warn(f"link '{other.joint.child}' turns as a wheel does; it does not drive")
    return named


def _turn_axis(joint: Joint, poses: Mapping[str, FloatArray]) -> FloatArray:
    length = math.hypot(*joint.axis)
    axis: FloatArray = poses[joint.child][:3, :3] @ np.array(joint.axis) / (length or 1.0)
    return axis


def leave_driven(
    root: ET.Element,
    wheels: Sequence[Wheel],
    joints: Sequence[Joint],
    poses: Mapping[str, FloatArray],
    source: SourceFile,
) -> list[Wheel]:
    """Return the driven wheels, fewer than four if the robot has no more; report castors.

    Raises: DescriptionError: the robot steers wheels, drives sideways, on tracks, on two wheels and
        castors, or on wheels that are no pairs, or more than eight.
    """
    wheels = _leave_named(wheels, source)
    _check_plugins(root, source)
    _check_controllers(root, source)
    _check_sideways(root, wheels, joints, source)
    _check_axles(wheels, source)
    turned = {wheel.joint.child: _find_steering(wheel, joints, poses) for wheel in wheels}
    castors = [w for w in wheels if _is_castor(w, turned[w.joint.child])]
    steered = [w for w in wheels if turned[w.joint.child] and w not in castors]
    if steered:
        names = _quote(turned[wheel.joint.child] for wheel in steered)
        raise source.fail("wheels", f"{_name(steered)} are steered, by {names}; {ONLY}; {TO_TRY}")
    driven = [wheel for wheel in wheels if wheel not in castors]
    if castors and len(driven) < len(WHEEL_NAMES):
        raise source.fail(
            "wheels",
            f"it drives on {_name(driven)} and rolls on castors ({_name(castors)}); {ONLY}",
        )
    for castor in castors:
        rest = f"{_count(driven)} wheels carry the robot"
        source.warn(f"castor '{castor.joint.child}' is not simulated; {rest}")
    _check_number(driven, source)
    _warn_of_undriven(root, driven, source)
    return driven


def list_fixed_castors(root: ET.Element) -> list[str]:
    """List links that are called castors, such as spheres that slide."""
    names = [link.get("name", "") for link in root.findall("link")]
    return [name for name in names if any(word in name.lower() for word in CASTOR_WORDS)]


def _check_plugins(root: ET.Element, source: SourceFile) -> None:
    for _link, block in iterate_gazebo_blocks(root):
        for plugin in block.iter("plugin"):
            file = plugin.get("filename", "")
            _check_words(f"plugin '{file}'", f"{file} {plugin.get('name', '')}", source)


def _check_controllers(root: ET.Element, source: SourceFile) -> None:
    """Refuse a robot whose ros2_control drives otherwise, by its name or that of its hardware."""
    for block in root.iter("ros2_control"):
        name = block.get("name", "")
        plugins = " ".join(plugin.text or "" for plugin in block.iter("plugin"))
        _check_words(f"ros2_control '{name}'", f"{name} {plugins}", source)


def _check_words(where: str, words: str, source: SourceFile) -> None:
    for kind, marks in OTHER_DRIVES.items():
        if any(mark in words.lower() for mark in marks):
            raise source.fail(where, f"it {kind}; {ONLY}")


def _check_axles(wheels: Sequence[Wheel], source: SourceFile) -> None:
    """Refuse wheels that are set oblique, as on a robot that drives in every direction."""
    oblique = [wheel for wheel in wheels if abs(wheel.axle[0]) > ALONG]
    if oblique:
        raise source.fail("wheels", f"the axles of {_name(oblique)} lie oblique (omni); {ONLY}")


def _check_sideways(
    root: ET.Element, wheels: Sequence[Wheel], joints: Sequence[Joint], source: SourceFile
) -> None:
    """Refuse wheels with rollers: by their names, their rollers, or their oblique friction."""
    turning = [joint.parent for joint in joints if joint.kind == "continuous"]
    sideways = [
        wheel
        for wheel in wheels
        if any(word in wheel.names for word in SIDEWAYS_WORDS)
        or turning.count(wheel.joint.child) >= ROLLERS
        or _has_roller_mesh(root, wheel)
        or _has_oblique_friction(root, wheel)
    ]
    if sideways:
        raise source.fail(
            "wheels", f"{_name(sideways)} have rollers (mecanum) and drive sideways; {ONLY}"
        )


def _has_roller_mesh(root: ET.Element, wheel: Wheel) -> bool:
    """Return whether a file of the wheel's shape has a name of wheels with rollers."""
    files = [
        mesh.get("filename", "").rpartition("/")[2].lower()
        for link in root.findall("link")
        if link.get("name") == wheel.joint.child
        for mesh in link.iter("mesh")
    ]
    return any(word in file for file in files for word in SIDEWAYS_WORDS)


def _has_oblique_friction(root: ET.Element, wheel: Wheel) -> bool:
    for link, block in iterate_gazebo_blocks(root):
        along = block.find(".//fdir1") if link == wheel.joint.child else None
        words = "" if along is None else along.get("value") or along.text or ""
        try:
            x, y, z = (abs(float(word)) for word in words.split())
        except ValueError:  # missing, or reported where friction is read
            continue
        first, second, _ = sorted((x, y, z), reverse=True)
        if second > OBLIQUE * first:
            return True
    return False


def _find_steering(wheel: Wheel, joints: Sequence[Joint], poses: Mapping[str, FloatArray]) -> str:
    """Return the joint above a wheel that turns it about the vertical; empty without one."""
    above = {joint.child: joint for joint in joints}
    name, seen = wheel.joint.parent, set[str]()
    while name in above and name not in seen:
        seen.add(name)
        joint = above[name]
        if joint.kind in TURNING and abs(_turn_axis(joint, poses)[2]) > UPRIGHT:
            return joint.name
        name = joint.parent
    return ""


def _is_castor(wheel: Wheel, steering: str) -> bool:
    return any(word in f"{wheel.names} {steering.lower()}" for word in CASTOR_WORDS)


def pair_wheels(wheels: Sequence[Wheel]) -> list[tuple[Wheel, Wheel]]:
    """Pair the wheels from the rear to the front, each pair right and left."""
    ordered = sorted(wheels, key=lambda wheel: float(wheel.centre_m[0]))
    pairs = [sorted(ordered[k : k + 2], key=_find_left_m) for k in range(0, len(ordered) - 1, 2)]
    return [(pair[0], pair[1]) for pair in pairs]


def _check_number(driven: Sequence[Wheel], source: SourceFile) -> None:
    """Refuse wheels that are more than four and no pairs, each with one on either side."""
    more = len(driven) - len(WHEEL_NAMES)
    if more <= 0:
        return
    if more not in MIDDLE_WHEEL_NAMES:
        names = f"{len(driven)} wheels ({_name(driven)})"
        raise source.fail("wheels", f"it stands on {names}; {ONLY}; {TO_TRY}")
    middle_m = sum(map(_find_left_m, driven)) / len(driven)
    for right, left in pair_wheels(driven):
        if not _find_left_m(right) < middle_m < _find_left_m(left):
            names = _name((right, left))
            raise source.fail("wheels", f"{names} are no pair, right and left; {ONLY}; {TO_TRY}")


def _find_left_m(wheel: Wheel) -> float:
    return float(wheel.centre_m[1])


def _warn_of_undriven(root: ET.Element, driven: Sequence[Wheel], source: SourceFile) -> None:
    """Warn of wheels that the robot's own drive leaves to roll."""
    for what, named in _list_drives(root, source):
        rolling = [wheel for wheel in driven if wheel.joint.name not in named]
        if not 0 < len(rolling) < len(driven):
            continue
        undriven = f"{what} does not drive {_name(rolling)}"
        if len(driven) > len(WHEEL_NAMES) > len(driven) - len(rolling):
            raise source.fail("wheels", f"{undriven}, which would roll along; {ONLY}; {TO_TRY}")
        source.warn(f"{undriven}; here all {_count(driven)} wheels drive")


def _list_drives(root: ET.Element, source: SourceFile) -> Iterator[tuple[str, set[str]]]:
    """List what says which joints are driven, and their names."""
    plugin = find_plugin(root, DRIVE_PLUGINS, source)
    if plugin is not None:
        joints = [e for e in plugin.element if e.tag.lower().endswith("joint")]
        yield plugin.what, {read_tag_value(element) for element in joints}
    transmitted = root.findall("transmission/joint")
    yield "<transmission>", {joint.get("name", "") for joint in transmitted}
    for block in root.findall("ros2_control"):
        commanded = [e for e in block.findall("joint") if e.find("command_interface") is not None]
        named = {joint.get("name", "") for joint in commanded}
        yield f"ros2_control '{block.get('name', '')}'", named


def _count(wheels: Sequence[Wheel]) -> str:
    return {4: "four", 6: "six", 8: "eight"}.get(len(wheels), str(len(wheels)))


def _name(wheels: Sequence[Wheel]) -> str:
    return _quote(wheel.joint.child for wheel in wheels) or "no wheel"


def _quote(names: Iterator[str]) -> str:
    return ", ".join(f"'{name}'" for name in dict.fromkeys(names))
