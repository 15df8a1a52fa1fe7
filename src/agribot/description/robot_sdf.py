"""The robot as an SDF model, with plugins and sensors of gz-sim.

The model's frame is the body frame: on the ground, below base_link. SDF has no links without
mass, so those become frames, and what they show or measure goes to the link that carries them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from agribot.core.geo import inverse
from agribot.core.messages import FloatArray
from agribot.core.robot import CameraSpec, RobotSpec, Shape
from agribot.description.poses import origin_of

BASE = "base_link"
LEFT, RIGHT = ("left_wheel_F", "left_wheel_R"), ("right_wheel_F", "right_wheel_R")


def sdf_text(robot: RobotSpec) -> str:
    """SDF 1.9 of a robot; meshes keep their package:// names."""
    root = ET.Element("sdf", {"version": "1.9"})
    model = ET.SubElement(root, "model", {"name": robot.name})
    carriers = {link.name: _carrier(robot, link.name) for link in robot.links}
    heavy = {name: ET.SubElement(model, "link", {"name": name}) for name in _ordered(carriers)}
    for name, element in heavy.items():
        _pose(element, robot.body_from_link(name))
        _inertial(element, robot, name)
    for link in robot.links:
        carrier = carriers[link.name]
        place = inverse(robot.base_from_link(carrier)) @ robot.base_from_link(link.name)
        if carrier != link.name:
            frame = ET.SubElement(model, "frame", {"name": link.name, "attached_to": carrier})
            _pose(frame, place)
        for kind, shapes in (("collision", link.collisions), ("visual", link.visuals)):
            for index, shape in enumerate(shapes):
                name = f"{link.name}_{kind}_{index}"
                part = ET.SubElement(heavy[carrier], kind, {"name": name})
                _shape(part, shape, place, kind)
    _joints(model, robot, carriers)
    _sensors(heavy, robot, carriers)
    _drive(model, robot)
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _ordered(carriers: dict[str, str]) -> list[str]:
    """base_link first: SDF takes the first link for the one that the model's pose speaks of."""
    names = dict.fromkeys(carriers.values())
    return [BASE, *(name for name in names if name != BASE)]


def _carrier(robot: RobotSpec, name: str) -> str:
    """The link with a mass that a link is fixed to, or itself."""
    joints = {joint.child: joint for joint in robot.joints}
    while robot.link(name).mass_kg <= 0.0 and name in joints and name != BASE:
        name = joints[name].parent
    return name if robot.link(name).mass_kg > 0.0 else BASE


def _text(parent: ET.Element, tag: str, *values: float | str) -> ET.Element:
    element = ET.SubElement(parent, tag)
    words = (v if isinstance(v, str) else f"{v + 0.0:.12g}" for v in values)
    element.text = " ".join(words)
    return element


def _pose(parent: ET.Element, matrix: FloatArray) -> None:
    origin = origin_of(matrix)
    if np.any(np.abs((*origin.xyz_m, *origin.rpy_rad)) > 1e-12):
        _text(parent, "pose", *origin.xyz_m, *origin.rpy_rad)


def _inertial(element: ET.Element, robot: RobotSpec, name: str) -> None:
    link = robot.link(name)
    inertial = ET.SubElement(element, "inertial")
    _pose(inertial, link.com.matrix())
    _text(inertial, "mass", link.mass_kg)
    inertia = ET.SubElement(inertial, "inertia")
    for tag, value in zip(
        ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), link.inertia_kgm2, strict=True
    ):
        _text(inertia, tag, value)


def _shape(part: ET.Element, shape: Shape, place: FloatArray, kind: str) -> None:
    _pose(part, place @ shape.origin.matrix())
    form = ET.SubElement(ET.SubElement(part, "geometry"), shape.kind)
    if shape.kind == "box":
        _text(form, "size", *shape.size_m)
    elif shape.kind == "mesh":
        _text(form, "uri", shape.mesh)
        _text(form, "scale", *shape.size_m)
    else:
        _text(form, "radius", shape.size_m[0])
        if shape.kind == "cylinder":
            _text(form, "length", shape.size_m[1])
    if kind == "visual":
        material = ET.SubElement(part, "material")
        _text(material, "ambient", *shape.rgba)
        _text(material, "diffuse", *shape.rgba)


def _joints(model: ET.Element, robot: RobotSpec, carriers: dict[str, str]) -> None:
    for joint in robot.joints:
        if carriers[joint.child] != joint.child or joint.child == BASE:
            continue
        turns = joint.kind in {"continuous", "revolute"}
        kind = joint.kind if turns else "fixed"
        element = ET.SubElement(model, "joint", {"name": joint.name, "type": kind})
        _text(element, "parent", carriers[joint.parent])
        _text(element, "child", joint.child)
        if turns:
            axis = ET.SubElement(element, "axis")
            _text(axis, "xyz", *(np.array(joint.axis) / np.linalg.norm(joint.axis)).tolist())
            if np.isfinite(joint.effort_nm):
                _text(ET.SubElement(axis, "limit"), "effort", joint.effort_nm)


def _sensors(heavy: dict[str, ET.Element], robot: RobotSpec, carriers: dict[str, str]) -> None:
    mounts = (("imu", robot.imu), ("navsat", robot.gnss), ("magnetometer", robot.mag))
    for kind, mount in mounts:
        _sensor(heavy, robot, carriers, mount.link, kind, mount.rate_hz)
    if robot.camera is not None:
        camera = robot.camera
        sensor = _sensor(heavy, robot, carriers, camera.link, "camera", camera.rate_hz)
        _camera(sensor, camera)


def _sensor(
    heavy: dict[str, ET.Element], robot: RobotSpec, carriers: dict[str, str], link: str, kind: str,
    rate_hz: float,
) -> ET.Element:  # fmt: skip
    carrier = carriers[link]
    sensor = ET.SubElement(heavy[carrier], "sensor", {"name": kind, "type": kind})
    _pose(sensor, inverse(robot.base_from_link(carrier)) @ robot.base_from_link(link))
    _text(sensor, "update_rate", rate_hz)
    return sensor


def _camera(sensor: ET.Element, spec: CameraSpec) -> None:
    camera = ET.SubElement(sensor, "camera")
    _text(camera, "horizontal_fov", spec.hfov_rad)
    image = ET.SubElement(camera, "image")
    _text(image, "width", spec.width_px)
    _text(image, "height", spec.height_px)
    clip = ET.SubElement(camera, "clip")
    _text(clip, "near", spec.clip_near_m)
    _text(clip, "far", spec.clip_far_m)
    noise = ET.SubElement(camera, "noise")
    _text(noise, "type", "gaussian")
    _text(noise, "mean", 0.0)
    _text(noise, "stddev", spec.noise_std)
    if any(spec.distortion):
        lens = ET.SubElement(camera, "distortion")
        for name, value in zip(("k1", "k2", "p1", "p2"), spec.distortion, strict=True):
            _text(lens, name, value)
        _text(lens, "center", "0.5 0.5")


def _drive(model: ET.Element, robot: RobotSpec) -> None:
    """Wheel radius as measured, and the separation that a skidding robot turns by."""
    names = {"filename": "gz-sim-diff-drive-system", "name": "gz::sim::systems::DiffDrive"}
    plugin = ET.SubElement(model, "plugin", names)
    joints = {joint.child: joint.name for joint in robot.joints}
    sides: tuple[tuple[str, Sequence[str]], ...] = (("left_joint", LEFT), ("right_joint", RIGHT))
    for tag, wheels in sides:
        for wheel in wheels:
            _text(plugin, tag, joints[wheel])
    _text(plugin, "wheel_separation", robot.drive.effective_separation_m)
    _text(plugin, "wheel_radius", robot.drive.wheel_radius_m)
    _text(plugin, "topic", "cmd_vel")
