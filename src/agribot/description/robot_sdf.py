"""The robot as an SDF model, with plugins and sensors of gz-sim.

The model's frame is the body frame: on the ground, below base_link. SDF has no links without
mass, so those become frames, and their visuals and sensors go to the link that carries them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from agribot.core.geo import inverse
from agribot.core.messages import FloatArray
from agribot.core.robot import CameraSpec, RobotSpec, Shape
from agribot.description.poses import to_origin

BASE = "base_link"
LEFT, RIGHT = ("left_wheel_F", "left_wheel_R"), ("right_wheel_F", "right_wheel_R")


def export_sdf(robot: RobotSpec) -> str:
    """Export a robot as SDF 1.9; meshes keep their package:// names."""
    root = ET.Element("sdf", {"version": "1.9"})
    model = ET.SubElement(root, "model", {"name": robot.name})
    carriers = {link.name: _find_carrier(robot, link.name) for link in robot.links}
    heavy = {name: ET.SubElement(model, "link", {"name": name}) for name in _order_links(carriers)}
    for name, element in heavy.items():
        _add_pose(element, robot.body_from_link(name))
        _add_inertial(element, robot, name)
    for link in robot.links:
        carrier = carriers[link.name]
        place = inverse(robot.base_from_link(carrier)) @ robot.base_from_link(link.name)
        if carrier != link.name:
            frame = ET.SubElement(model, "frame", {"name": link.name, "attached_to": carrier})
            _add_pose(frame, place)
        for kind, shapes in (("collision", link.collisions), ("visual", link.visuals)):
            for index, shape in enumerate(shapes):
                name = f"{link.name}_{kind}_{index}"
                part = ET.SubElement(heavy[carrier], kind, {"name": name})
                _add_shape(part, shape, place, kind)
    _add_joints(model, robot, carriers)
    _add_sensors(heavy, robot, carriers)
    _add_drive(model, robot)
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _order_links(carriers: dict[str, str]) -> list[str]:
    """Order the links, base_link first: in SDF the model's pose is that of the first link."""
    names = dict.fromkeys(carriers.values())
    return [BASE, *(name for name in names if name != BASE)]


def _find_carrier(robot: RobotSpec, name: str) -> str:
    """Return the link with a mass that a link is fixed to, or itself."""
    joints = {joint.child: joint for joint in robot.joints}
    while robot.link(name).mass_kg <= 0.0 and name in joints and name != BASE:
        name = joints[name].parent
    return name if robot.link(name).mass_kg > 0.0 else BASE


def _add_text(parent: ET.Element, tag: str, *values: float | str) -> ET.Element:
    element = ET.SubElement(parent, tag)
    words = (v if isinstance(v, str) else f"{v + 0.0:.12g}" for v in values)
    element.text = " ".join(words)
    return element


def _add_pose(parent: ET.Element, matrix: FloatArray) -> None:
    origin = to_origin(matrix)
    if np.any(np.abs((*origin.xyz_m, *origin.rpy_rad)) > 1e-12):
        _add_text(parent, "pose", *origin.xyz_m, *origin.rpy_rad)


def _add_inertial(element: ET.Element, robot: RobotSpec, name: str) -> None:
    link = robot.link(name)
    inertial = ET.SubElement(element, "inertial")
    _add_pose(inertial, link.com.matrix())
    _add_text(inertial, "mass", link.mass_kg)
    inertia = ET.SubElement(inertial, "inertia")
    for tag, value in zip(
        ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), link.inertia_kgm2, strict=True
    ):
        _add_text(inertia, tag, value)


def _add_shape(part: ET.Element, shape: Shape, place: FloatArray, kind: str) -> None:
    _add_pose(part, place @ shape.origin.matrix())
    form = ET.SubElement(ET.SubElement(part, "geometry"), shape.kind)
    if shape.kind == "box":
        _add_text(form, "size", *shape.size_m)
    elif shape.kind == "mesh":
        _add_text(form, "uri", shape.mesh)
        _add_text(form, "scale", *shape.size_m)
    else:
        _add_text(form, "radius", shape.size_m[0])
        if shape.kind == "cylinder":
            _add_text(form, "length", shape.size_m[1])
    if kind == "visual":
        material = ET.SubElement(part, "material")
        _add_text(material, "ambient", *shape.rgba)
        _add_text(material, "diffuse", *shape.rgba)


def _add_joints(model: ET.Element, robot: RobotSpec, carriers: dict[str, str]) -> None:
    for joint in robot.joints:
        if carriers[joint.child] != joint.child or joint.child == BASE:
            continue
        turns = joint.kind in {"continuous", "revolute"}
        kind = joint.kind if turns else "fixed"
        element = ET.SubElement(model, "joint", {"name": joint.name, "type": kind})
        _add_text(element, "parent", carriers[joint.parent])
        _add_text(element, "child", joint.child)
        if turns:
            axis = ET.SubElement(element, "axis")
            _add_text(axis, "xyz", *(np.array(joint.axis) / np.linalg.norm(joint.axis)).tolist())
            if np.isfinite(joint.effort_nm):
                _add_text(ET.SubElement(axis, "limit"), "effort", joint.effort_nm)


def _add_sensors(heavy: dict[str, ET.Element], robot: RobotSpec, carriers: dict[str, str]) -> None:
    mounts = (("imu", robot.imu), ("navsat", robot.gnss), ("magnetometer", robot.mag))
    for kind, mount in mounts:
        if mount is not None:
            _add_sensor(heavy, robot, carriers, mount.link, kind, mount.rate_hz)
    if robot.camera is not None:
        camera = robot.camera
        sensor = _add_sensor(heavy, robot, carriers, camera.link, "camera", camera.rate_hz)
        _add_camera(sensor, camera)


def _add_sensor(
    heavy: dict[str, ET.Element], robot: RobotSpec, carriers: dict[str, str], link: str, kind: str,
    rate_hz: float,
) -> ET.Element:  # fmt: skip
    carrier = carriers[link]
    sensor = ET.SubElement(heavy[carrier], "sensor", {"name": kind, "type": kind})
    _add_pose(sensor, inverse(robot.base_from_link(carrier)) @ robot.base_from_link(link))
    _add_text(sensor, "update_rate", rate_hz)
    return sensor


def _add_camera(sensor: ET.Element, spec: CameraSpec) -> None:
    camera = ET.SubElement(sensor, "camera")
    _add_text(camera, "horizontal_fov", spec.hfov_rad)
    image = ET.SubElement(camera, "image")
    _add_text(image, "width", spec.width_px)
    _add_text(image, "height", spec.height_px)
    clip = ET.SubElement(camera, "clip")
    _add_text(clip, "near", spec.clip_near_m)
    _add_text(clip, "far", spec.clip_far_m)
    noise = ET.SubElement(camera, "noise")
    _add_text(noise, "type", "gaussian")
    _add_text(noise, "mean", 0.0)
    _add_text(noise, "stddev", spec.noise_std)
    if any(spec.distortion):
        lens = ET.SubElement(camera, "distortion")
        for name, value in zip(("k1", "k2", "p1", "p2"), spec.distortion, strict=True):
            _add_text(lens, name, value)
        _add_text(lens, "center", "0.5 0.5")


def _add_drive(model: ET.Element, robot: RobotSpec) -> None:
    """Add the drive, with the effective separation of a skidding robot."""
    names = {"filename": "gz-sim-diff-drive-system", "name": "gz::sim::systems::DiffDrive"}
    plugin = ET.SubElement(model, "plugin", names)
    joints = {joint.child: joint.name for joint in robot.joints}
    sides: tuple[tuple[str, Sequence[str]], ...] = (("left_joint", LEFT), ("right_joint", RIGHT))
    for tag, wheels in sides:
        for wheel in wheels:
            _add_text(plugin, tag, joints[wheel])
    _add_text(plugin, "wheel_separation", robot.drive.effective_separation_m)
    _add_text(plugin, "wheel_radius", robot.drive.wheel_radius_m)
    _add_text(plugin, "topic", "cmd_vel")
