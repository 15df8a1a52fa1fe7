"""Other people's robots: drive, tyres and sensors that their description leaves out."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import GRAVITY_MPS2, Joint, Link
from agribot.description.adopt_wheels import list_middle_wheels
from agribot.description.devices import (
    find_wheel_size,
    is_in_plugin,
)
from agribot.description.elements import SourceFile
from agribot.description.tags import (
    DRIVE_PLUGINS,
    GNSS,
    IMU,
    MAG,
    SensorKind,
    TagBlock,
    find_extra,
    find_plugin,
    find_sensor,
)
from agribot.description.turning import compute_yaw_multiplier

# The packaged robot, whose drive and tyres others are scaled from.
MASS_KG, RADIUS_M = 5.1122, 0.09
TINY = 1e-9  # least mass in use; a robot without mass is refused later
SAME_MULTIPLIER = 0.05
MIN_TORQUE_RATIO = 0.5  # least share of weight times wheel radius, for each wheel
CAMERA_HEIGHT_M, CAMERA_PITCH_RAD = 0.9, math.radians(50.0)


def adopt_devices(
    root: ET.Element, links: Sequence[Link], joints: Sequence[Joint], source: SourceFile
) -> None:
    """Add the missing tags, with values that fit the size and mass of the robot."""
    foreign = not [*root.findall("gazebo/agribot"), *root.findall("agribot")]
    radius_m, _width_m = find_wheel_size(links, source)
    at_m = {joint.child: joint.origin.xyz_m for joint in joints if joint.child in WHEEL_NAMES}
    half_base_m = abs(at_m["left_wheel_F"][0] - at_m["left_wheel_R"][0]) / 2.0
    half_track_m = abs(at_m["left_wheel_F"][1] - at_m["right_wheel_F"][1]) / 2.0
    mass_kg = sum(link.mass_kg for link in links)
    scale = mass_kg / MASS_KG
    inertia = scale * (radius_m / RADIUS_M) ** 2
    efforts = [j.effort_nm for j in joints if j.child in WHEEL_NAMES and j.effort_nm > 0.0]
    torque_nm = min([MIN_TORQUE_RATIO * mass_kg * GRAVITY_MPS2 * radius_m, *efforts])
    drive = {
        "yaw_multiplier": _find_multiplier(joints, half_base_m, half_track_m),
        "rotor_inertia_kgm2": 1.42e-3 * inertia, "servo_gain_nmspr": 1.0 * inertia,
        "pid_p_nmspr": 0.3 * inertia, "pid_i_nmprad": 3.0 * inertia,
        "pid_d_nms2prad": 5e-4 * inertia,
        "command_timeout_s": 0.5, "max_speed_mps": 0.8, "max_yaw_rate_radps": 1.0,
        "max_accel_mps2": 1.0, "max_yaw_accel_radps2": 2.0, "encoder_ticks_per_rev": 1024.0,
        # The same voltage at the same speed over ground, and currents that grow with the mass.
        "torque_constant_nmpa": 0.302 * radius_m / RADIUS_M,
        "winding_ohm": 0.299 / max(scale, TINY), "no_load_a": 0.137 * scale,
    }  # fmt: skip
    block = find_extra(root, "drive", source)
    if block is not None and list_middle_wheels(joints):
        _check_multiplier(block, drive["yaw_multiplier"], source)
    if block is None or "motor_torque_nm" not in block.tags:
        drive["gear_efficiency_ratio"] = 0.83
    tyre = {
        "normal_stiffness_npm": 1e4 * scale, "normal_damping_ratio": 0.4,
        "bristle_stiffness_npm": 5e3 * scale, "rolling_resistance_ratio": 0.03,
        # The tyre gives as far as the packaged one, so that the contact grows with the root.
        "relaxation_length_m": 0.03 * math.sqrt(radius_m / RADIUS_M),
        "ground_mu1": 100.0, "ground_mu2": 50.0,
    }  # fmt: skip
    _add_drive_plugin(root, torque_nm, radius_m, 2.0 * half_track_m, source)
    _add_extra(root, "drive", drive, source)
    _add_extra(root, "tyre", tyre, source)
    _add_contact(root, source)
    for kind in (IMU, GNSS, MAG):
        _add_sensor(root, kind, links, source)
        if foreign:
            _move_to_base(root, kind, links, source)
    if foreign and find_sensor(root, ("camera",)) is None:
        _add_camera(root, half_base_m, at_m["left_wheel_F"][2] - radius_m, source)


def _find_multiplier(joints: Sequence[Joint], half_base_m: float, half_track_m: float) -> float:
    middle = list_middle_wheels(joints)
    if not middle:
        return (half_base_m**2 + half_track_m**2) / half_track_m**2
    at_m = {joint.child: joint.origin.xyz_m[0] for joint in joints}
    centre_m = (at_m["left_wheel_F"] + at_m["left_wheel_R"]) / 2.0
    arms_m = [half_base_m, half_base_m, -half_base_m, -half_base_m]
    arms_m += [at_m[name] - centre_m for name in middle]
    return compute_yaw_multiplier(arms_m, half_track_m)


def _check_multiplier(block: TagBlock, fitting: float, source: SourceFile) -> None:
    """Warn of a multiplier that does not fit the places of more than four wheels."""
    if "yaw_multiplier" not in block.tags:
        return
    written = block.read_positive("yaw_multiplier")
    if abs(written - fitting) > SAME_MULTIPLIER * fitting:
        source.warn(
            f"{block.what}: <yaw_multiplier> is {written:.4g}; from the places of all wheels it is "
            f"{fitting:.4g}; write that, unless it was measured",
            block.element,
        )


def _add_drive_plugin(
    root: ET.Element, torque_nm: float, radius_m: float, track_m: float, source: SourceFile
) -> None:
    values = {
        "updateRate": 50.0, "torque": torque_nm,
        "wheelDiameter": 2.0 * radius_m, "wheelSeparation": track_m,
    }  # fmt: skip
    found = find_plugin(root, DRIVE_PLUGINS, source)
    if found is None:
        source.warn("no drive plugin (skid steer); one with usual numbers is used")
        block = ET.SubElement(root, "gazebo")
        name = "libgazebo_ros_skid_steer_drive.so"
        plugin = ET.SubElement(block, "plugin", {"name": "drive", "filename": name})
    else:
        plugin = found.element
    for tag, value in values.items():
        if found is not None and is_in_plugin(found, tag):
            continue
        ET.SubElement(plugin, tag).text = _format_number(value)
        if found is not None:
            source.warn(f"{found.what}: <{tag}> is missing; {value:.4g} is used", plugin)


def _add_extra(root: ET.Element, group: str, numbers: dict[str, float], source: SourceFile) -> None:
    block = find_extra(root, group, source)
    if block is None:
        source.warn(f"<agribot>: <{group}> is missing; numbers that fit the mass are used")
        extra = next(iter(root.findall("gazebo/agribot")), None)
        if extra is None:
            extra = ET.SubElement(ET.SubElement(root, "gazebo"), "agribot")
        element = ET.SubElement(extra, group)
    else:
        element = block.element
    for tag, value in numbers.items():
        if block is None or tag not in block.tags:
            ET.SubElement(element, tag).text = _format_number(value)
            if block is not None:
                source.warn(f"{block.what}: <{tag}> is missing; {value:.4g} is used", element)


def _add_contact(root: ET.Element, source: SourceFile) -> None:
    name = WHEEL_NAMES[0]
    blocks = [block for block in root.findall("gazebo") if block.get("reference") == name]
    for tag in ("mu1", "mu2"):
        if any(block.find(tag) is not None for block in blocks):
            continue
        if not blocks:
            blocks = [ET.SubElement(root, "gazebo", {"reference": name})]
        ET.SubElement(blocks[0], tag).text = "1.0"
        source.warn(f"wheels: <{tag}> is missing; a friction of 1 is used", quiet=True)


def _add_sensor(
    root: ET.Element, kind: SensorKind, links: Sequence[Link], source: SourceFile
) -> None:
    plugin = find_plugin(root, kind.plugins, source)
    if plugin is not None and "updaterate" in plugin.tags:
        if not (plugin.tags.get("bodyname") or plugin.link):
            ET.SubElement(plugin.element, "bodyName").text = "base_link"
            source.warn(f"{plugin.what}: <bodyName> is missing; base_link is used")
        return
    found = find_sensor(root, kind.types)
    if found is None:
        link = next((x.name for x in links if _has_word(x.name, kind.words)), "")
        if not link and kind.is_optional:
            return
        link = link or "base_link"
        source.warn(f"no {kind.what}; one at {kind.rate_hz:g} Hz on '{link}' is used")
        block = ET.SubElement(root, "gazebo", {"reference": link})
        name = {"name": kind.types[-1], "type": kind.types[-1]}
        ET.SubElement(ET.SubElement(block, "sensor", name), "update_rate").text = _format_number(
            kind.rate_hz
        )
        return
    _link, sensor = found
    if sensor.find("update_rate") is None:
        ET.SubElement(sensor, "update_rate").text = _format_number(kind.rate_hz)
        source.warn(f"{kind.what}: <update_rate> is missing; {kind.rate_hz:g} Hz is used", sensor)


def _move_to_base(
    root: ET.Element, kind: SensorKind, links: Sequence[Link], source: SourceFile
) -> None:
    """Put a plugin on base_link that names a link which does not exist."""
    plugin = find_plugin(root, kind.plugins, source)
    body = "" if plugin is None else plugin.tags.get("bodyname", "")
    if plugin is None or not body or any(link.name == body for link in links):
        return
    source.warn(f"{kind.what}: there is no link '{body}'; base_link is used", plugin.element)
    for element in plugin.element:
        if element.tag.lower() == "bodyname":
            element.text = "base_link"


def _has_word(name: str, words: tuple[str, ...]) -> bool:
    return any(word in name.lower() for word in words)


def _add_camera(root: ET.Element, front_m: float, ground_m: float, source: SourceFile) -> None:
    """Add the default camera on a mast over the front axle, looking down at the row ahead."""
    names = {link.get("name") for link in root.findall("link")}
    name = next(n for n in ("camera_link", "agribot_camera_link") if n not in names or n[0] == "a")
    source.warn(f"no camera; one at {CAMERA_HEIGHT_M} m over the ground is used")
    ET.SubElement(root, "link", {"name": name})
    joint = ET.SubElement(root, "joint", {"name": f"base_link_to_{name}", "type": "fixed"})
    xyz = f"{_format_number(front_m)} 0 {_format_number(CAMERA_HEIGHT_M + ground_m)}"
    ET.SubElement(joint, "origin", {"xyz": xyz, "rpy": f"0 {_format_number(CAMERA_PITCH_RAD)} 0"})
    ET.SubElement(joint, "parent", {"link": "base_link"})
    ET.SubElement(joint, "child", {"link": name})
    block = ET.SubElement(root, "gazebo", {"reference": name})
    sensor = ET.SubElement(block, "sensor", {"name": "camera", "type": "camera"})
    sensor.append(
        ET.fromstring(
            "<camera><horizontal_fov>1.3962634</horizontal_fov><image><width>640</width>"
            "<height>480</height></image><clip><near>0.02</near><far>300</far></clip></camera>"
        )
    )
    ET.SubElement(sensor, "update_rate").text = "30"


def _format_number(value: float) -> str:
    return f"{np.float64(value):.9g}"
