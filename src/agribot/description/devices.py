"""Drive, tyres and sensors of a URDF tree."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from agribot.core.messages import WHEEL_NAMES
from agribot.core.robot import (
    CameraSpec,
    DriveSpec,
    Joint,
    Link,
    SensorMount,
    TyreSpec,
)
from agribot.description.elements import SourceFile
from agribot.description.tags import (
    DRIVE_PLUGINS,
    GNSS,
    IMU,
    MAG,
    SensorKind,
    TagBlock,
    collect_contact_tags,
    find_extra,
    find_plugin,
    find_sensor,
    list_plugin_names,
)

MOST_RADIUS_M = 3.0  # radius of a wheel; the largest of tractors have 1.1
# Defaults that SDF has itself.
CAMERA_DEFAULTS = {
    "camera/image/width": 320.0, "camera/image/height": 240.0, "camera/horizontal_fov": 1.047,
    "update_rate": 30.0, "camera/clip/near": 0.1, "camera/clip/far": 100.0,
    "camera/noise/stddev": 0.0,
}  # fmt: skip
CAMERA_LIMITS = {
    "camera/image/width": (16.0, 8192.0), "camera/image/height": (16.0, 8192.0),
    "camera/horizontal_fov": (0.01, 3.1), "update_rate": (0.01, 1000.0),
    "camera/clip/near": (1e-4, 1e3), "camera/clip/far": (1e-3, 1e6),
}  # fmt: skip
# Optional in <agribot><drive>; without them the values of DriveSpec hold.
PID_TAGS = ("pid_p_nmspr", "pid_i_nmprad", "pid_d_nms2prad")
MOTOR_TAGS = (
    "motor_torque_nm", "gear_efficiency_ratio", "torque_constant_nmpa", "winding_ohm",
    "controller_efficiency_ratio",
)  # fmt: skip
LOSS_TAGS = ("no_load_a", "regeneration_ratio")


def read_drive(
    root: ET.Element, links: Sequence[Link], joints: Sequence[Joint], source: SourceFile
) -> DriveSpec:
    """Read the drive: geometry from the links and joints, torque and rates from the tags."""
    plugin = _require_plugin(root, DRIVE_PLUGINS, "drive plugin (skid steer)", source)
    extra = _require_extra(root, "drive", source)
    wheels = [_find_wheel(name, links, joints, source) for name in WHEEL_NAMES]
    radius_m, width_m = find_wheel_size(links, source)
    at_m = {name: joint.origin.xyz_m for name, (_, joint) in zip(WHEEL_NAMES, wheels, strict=True)}
    return DriveSpec(
        wheel_radius_m=radius_m,
        wheel_width_m=width_m,
        track_m=at_m["left_wheel_F"][1] - at_m["right_wheel_F"][1],
        wheelbase_m=at_m["left_wheel_F"][0] - at_m["left_wheel_R"][0],
        plugin_diameter_m=_read_plugin_number(plugin, "wheelDiameter", "wheel_radius", 2.0),
        plugin_separation_m=_read_plugin_number(plugin, "wheelSeparation", "wheel_separation", 1.0),
        yaw_multiplier=extra.read_positive("yaw_multiplier"),
        torque_nm=plugin.read_positive("torque"),
        gear_ratio=wheels[0][1].gear_ratio,
        encoder_ticks_per_rev=round(extra.read_positive("encoder_ticks_per_rev")),
        command_timeout_s=extra.read_positive("command_timeout_s"),
        max_speed_mps=extra.read_positive("max_speed_mps"),
        max_yaw_rate_radps=extra.read_positive("max_yaw_rate_radps"),
        max_accel_mps2=extra.read_positive("max_accel_mps2"),
        max_yaw_accel_radps2=extra.read_positive("max_yaw_accel_radps2"),
        rotor_inertia_kgm2=extra.read_number("rotor_inertia_kgm2"),
        servo_gain_nmspr=extra.read_positive("servo_gain_nmspr"),
        rate_hz=plugin.read_positive("updateRate"),
        **{name: extra.read_number(name) for name in PID_TAGS if name in extra.tags},
        **{name: extra.read_positive(name) for name in MOTOR_TAGS if name in extra.tags},
        **{name: extra.read_number(name) for name in LOSS_TAGS if name in extra.tags},
    )


def read_tyre(root: ET.Element, joints: Sequence[Joint], source: SourceFile) -> TyreSpec:
    """Read the tyre, with the smaller friction of wheel and ground in each direction."""
    extra = _require_extra(root, "tyre", source)
    if extra.tags.get("friction_rule", "min") != "min":
        raise source.fail(
            "<agribot><tyre>", f"friction_rule '{extra.tags['friction_rule']}' is unknown; use min"
        )
    name = WHEEL_NAMES[0]
    wheel = collect_contact_tags(root, name, source)
    first = min(wheel.read_friction("mu1"), extra.read_friction("ground_mu1"))
    second = min(wheel.read_friction("mu2"), extra.read_friction("ground_mu2"))
    axle = next(np.array(joint.axis) for joint in joints if joint.child == name)
    along = np.array(source.parse_vec3(wheel.tags.get("fdir1", "1 0 0"), f"{name} <fdir1>"))
    first_is_sideways = abs(float(axle @ along)) > 0.7 * float(np.linalg.norm(along))
    return TyreSpec(
        friction_longitudinal_ratio=second if first_is_sideways else first,
        friction_lateral_ratio=first if first_is_sideways else second,
        normal_stiffness_npm=extra.read_positive("normal_stiffness_npm"),
        normal_damping_ratio=extra.read_number("normal_damping_ratio"),
        bristle_stiffness_npm=extra.read_positive("bristle_stiffness_npm"),
        relaxation_length_m=extra.read_positive("relaxation_length_m"),
        rolling_resistance_ratio=extra.read_number("rolling_resistance_ratio"),
    )


def read_mounts(
    root: ET.Element, links: Sequence[Link], source: SourceFile
) -> tuple[SensorMount, SensorMount, SensorMount | None]:
    """Read the mounts of IMU, GNSS receiver and magnetometer; None where there is no such."""
    known = {link.name for link in links}
    return (
        _read_mount(root, IMU, known, source),
        _read_mount(root, GNSS, known, source),
        _find_mount(root, MAG, known, source),
    )


def read_camera(root: ET.Element, links: Sequence[Link], source: SourceFile) -> CameraSpec | None:
    found = find_sensor(root, ("camera",))
    if found is None:
        return None
    link, sensor = found
    _check_link(link, {known.name for known in links}, "camera", source)

    def read_number(path: str) -> float:
        text = sensor.findtext(path)
        if text is None and path in CAMERA_DEFAULTS:
            source.warn(f"camera sensor: <{path}> is missing; {CAMERA_DEFAULTS[path]:g} is used")
            return CAMERA_DEFAULTS[path]
        value = source.parse_number(text, f"camera sensor <{path}>")
        least, most = CAMERA_LIMITS.get(path, (0.0, math.inf))
        source.check_within(f"camera sensor <{path}>", value, least, most)
        return value

    return CameraSpec(
        link=link,
        width_px=round(read_number("camera/image/width")),
        height_px=round(read_number("camera/image/height")),
        hfov_rad=read_number("camera/horizontal_fov"),
        rate_hz=read_number("update_rate"),
        noise_std=read_number("camera/noise/stddev")
        if sensor.find("camera/noise") is not None
        else 0.0,
        clip_near_m=read_number("camera/clip/near"),
        clip_far_m=read_number("camera/clip/far"),
        distortion=_read_distortion(sensor, source),
    )


def _read_distortion(sensor: ET.Element, source: SourceFile) -> tuple[float, float, float, float]:
    """Read k1, k2, p1, p2 of SDF's <distortion>, else of the ROS camera plugin."""

    def read_coefficient(modern: str, classic: str) -> float:
        for path in (f"camera/distortion/{modern}", f"plugin/{classic}"):
            text = sensor.findtext(path)
            if text is not None:
                return source.parse_number(text, f"camera sensor <{path}>")
        return 0.0

    if read_coefficient("k3", "distortionK3"):
        source.warn("camera sensor: the distortion's k3 is not modelled; 0 is used")
    return (
        read_coefficient("k1", "distortionK1"),
        read_coefficient("k2", "distortionK2"),
        read_coefficient("p1", "distortionT1"),
        read_coefficient("p2", "distortionT2"),
    )


def _find_wheel(
    name: str, links: Sequence[Link], joints: Sequence[Joint], source: SourceFile
) -> tuple[Link, Joint]:
    link = next((link for link in links if link.name == name), None)
    joint = next((joint for joint in joints if joint.child == name), None)
    if link is None or joint is None:
        there = ", ".join(joint.child for joint in joints if joint.kind == "continuous") or "none"
        raise source.fail(
            "wheels", f"wheel link '{name}' with its joint is missing; turning links: {there}"
        )
    if joint.kind != "continuous" or joint.parent != "base_link":
        raise source.fail(
            f"joint '{joint.name}'",
            f"{joint.kind} on {joint.parent}; a wheel needs a continuous joint on base_link",
        )
    return link, joint


def find_wheel_size(links: Sequence[Link], source: SourceFile) -> tuple[float, float]:
    """Return radius and width of the collision cylinder of a wheel.

    Raises: DescriptionError: it has none, or one that is no wheel's.
    """
    wheel = next(link for link in links if link.name == WHEEL_NAMES[0])
    for shape in wheel.collisions:
        if shape.kind == "cylinder":
            radius_m, width_m, _ = shape.size_m
            if radius_m > MOST_RADIUS_M:
                raise source.fail(
                    f"link '{wheel.name}'",
                    f"a wheel of {radius_m:g} m radius > {MOST_RADIUS_M:g} m; a description is "
                    "in metres",
                )
            return radius_m, width_m
    kinds = ", ".join(shape.kind for shape in wheel.collisions) or "none"
    raise source.fail(
        f"link '{wheel.name}'", f"a wheel needs a <collision> with a cylinder; it has: {kinds}"
    )


MODERN = {"wheeldiameter": "wheel_radius", "wheelseparation": "wheel_separation"}


def is_in_plugin(plugin: TagBlock, name: str) -> bool:
    """Return whether a drive plugin has the number, in the classic spelling or that of gz-sim."""
    return name.lower() in plugin.tags or MODERN.get(name.lower()) in plugin.tags


def _read_plugin_number(plugin: TagBlock, classic: str, modern: str, factor: float) -> float:
    """Read a number of the drive plugin, in the classic spelling or that of gz-sim."""
    if classic.lower() not in plugin.tags and modern in plugin.tags:
        return factor * plugin.read_positive(modern)
    return plugin.read_positive(classic)


def _require_plugin(
    root: ET.Element, parts: tuple[str, ...], what: str, source: SourceFile
) -> TagBlock:
    plugin = find_plugin(root, parts, source)
    if plugin is None:
        raise source.fail("plugins", f"no {what}; there are: {list_plugin_names(root)}")
    return plugin


def _require_extra(root: ET.Element, group: str, source: SourceFile) -> TagBlock:
    block = find_extra(root, group, source)
    if block is None:
        raise source.fail(
            "<agribot>", f"<{group}> is missing; add <gazebo><agribot><{group}> with its numbers"
        )
    return block


def _read_mount(
    root: ET.Element, kind: SensorKind, links: set[str], source: SourceFile
) -> SensorMount:
    mount = _find_mount(root, kind, links, source)
    if mount is None:
        raise source.fail("sensors", f"no {kind.what}; there are: {list_plugin_names(root)}")
    return mount


def _find_mount(
    root: ET.Element, kind: SensorKind, links: set[str], source: SourceFile
) -> SensorMount | None:
    plugin = find_plugin(root, kind.plugins, source)
    if plugin is not None and "updaterate" in plugin.tags:
        link = plugin.tags.get("bodyname") or plugin.link
        rate_hz = plugin.read_positive("updateRate")
        _check_link(link, links, kind.what, source)
        return SensorMount(link=link, rate_hz=rate_hz, tags=plugin.tags)
    found = find_sensor(root, kind.types)
    if found is None:
        return None
    link, sensor = found
    block = TagBlock(sensor, f"sensor '{sensor.get('name')}'", source, link)
    _check_link(link, links, kind.what, source)
    return SensorMount(link=link, rate_hz=block.read_positive("update_rate"), tags=block.tags)


def _check_link(link: str, links: set[str], what: str, source: SourceFile) -> None:
    if link not in links:
        raise source.fail(
            what,
            f"it sits on link '{link}', which does not exist; links: {', '.join(sorted(links))}",
        )
