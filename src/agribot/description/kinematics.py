"""Links and joints of a URDF tree."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import TypeAlias

from agribot.core.robot import Joint, Link, Origin, Shape
from agribot.description.elements import Source

Rgba: TypeAlias = tuple[float, float, float, float]

GREY: Rgba = (0.7, 0.7, 0.7, 1.0)


def read_links(root: ET.Element, source: Source) -> tuple[Link, ...]:
    palette = read_palette(root, source)
    links = []
    for element in root.findall("link"):
        with source.attempt(element):
            links.append(_link(element, palette, source))
    return tuple(links)


def read_joints(root: ET.Element, source: Source) -> tuple[Joint, ...]:
    """All joints; raises DescriptionError if one names a link that does not exist."""
    gears = _gear_ratios(root, source)
    links = {element.get("name", "") for element in root.findall("link")}
    joints = []
    for element in root.findall("joint"):
        with source.attempt(element):
            joint = _joint(element, gears, source)
            for end in (joint.parent, joint.child):
                if end not in links:
                    raise source.fail(
                        f"joint '{joint.name}'",
                        f"there is no link '{end}'; there are: {', '.join(sorted(links))}",
                    )
            joints.append(joint)
    return tuple(joints)


def read_palette(root: ET.Element, source: Source) -> dict[str, Rgba]:
    """Named colours of the robot."""
    palette = {}
    for material in root.iter("material"):
        color = material.find("color")
        if color is not None:
            palette[material.get("name", "")] = _rgba(color, source)
    return palette


def _rgba(color: ET.Element, source: Source) -> Rgba:
    red, green, blue, alpha = source.numbers(color.get("rgba"), 4, "<color>")
    return red, green, blue, alpha


def _origin(element: ET.Element, source: Source, where: str) -> Origin:
    origin = element.find("origin")
    if origin is None:
        return Origin()
    return Origin(
        xyz_m=source.vec3(origin.get("xyz", "0 0 0"), f"{where} <origin xyz>"),
        rpy_rad=source.vec3(origin.get("rpy", "0 0 0"), f"{where} <origin rpy>"),
    )


def _link(element: ET.Element, palette: dict[str, Rgba], source: Source) -> Link:
    name = source.attribute(element, "name", "a link")
    where = f"link '{name}'"
    shapes = {
        tag: tuple(_shape(part, palette, source, where) for part in element.findall(tag))
        for tag in ("visual", "collision")
    }
    inertial = element.find("inertial")
    if inertial is None:
        return Link(name=name, visuals=shapes["visual"], collisions=shapes["collision"])
    mass = source.child(inertial, "mass", where)
    inertia = source.child(inertial, "inertia", where)
    ixx, iyy, izz, ixy, ixz, iyz = (
        source.number(inertia.get(key, "0"), f"{where} <inertia {key}>")
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    return Link(
        name=name,
        mass_kg=source.number(mass.get("value"), f"{where} <mass>"),
        com=_origin(inertial, source, where),
        inertia_kgm2=(ixx, iyy, izz, ixy, ixz, iyz),
        visuals=shapes["visual"],
        collisions=shapes["collision"],
    )


def _shape(part: ET.Element, palette: dict[str, Rgba], source: Source, where: str) -> Shape:
    geometry = source.child(part, "geometry", where)
    if len(geometry) == 0:
        raise source.fail(where, "<geometry> is empty; give it a box, cylinder, sphere or mesh")
    form = geometry[0]
    origin, rgba = _origin(part, source, where), _colour(part, palette, source)
    if form.tag == "box":
        size = source.vec3(form.get("size"), f"{where} <box>")
        return Shape(kind="box", size_m=size, origin=origin, rgba=rgba)
    if form.tag == "mesh":
        scale = source.vec3(form.get("scale", "1 1 1"), f"{where} <mesh>")
        file = source.attribute(form, "filename", where)
        return Shape(kind="mesh", size_m=scale, origin=origin, mesh=file, rgba=rgba)
    if form.tag not in {"cylinder", "sphere"}:
        raise source.fail(where, f"<{form.tag}> is no box, cylinder, sphere or mesh")
    radius_m = source.number(form.get("radius"), f"{where} <{form.tag} radius>")
    length_m = source.number(form.get("length", "0"), f"{where} <{form.tag} length>")
    return Shape(kind=form.tag, size_m=(radius_m, length_m, 0.0), origin=origin, rgba=rgba)


def _colour(part: ET.Element, palette: dict[str, Rgba], source: Source) -> Rgba:
    material = part.find("material")
    if material is None:
        return GREY
    color = material.find("color")
    if color is not None:
        return _rgba(color, source)
    return palette.get(material.get("name", ""), GREY)


def _joint(element: ET.Element, gears: dict[str, float], source: Source) -> Joint:
    name = source.attribute(element, "name", "a joint")
    where = f"joint '{name}'"
    axis, limit, dynamics = (element.find(tag) for tag in ("axis", "limit", "dynamics"))

    def number(part: ET.Element | None, key: str, default: float) -> float:
        text = None if part is None else part.get(key)
        return default if text is None else source.number(text, f"{where} {key}")

    return Joint(
        name=name,
        kind=source.attribute(element, "type", where),
        parent=source.attribute(source.child(element, "parent", where), "link", where),
        child=source.attribute(source.child(element, "child", where), "link", where),
        origin=_origin(element, source, where),
        axis=(1.0, 0.0, 0.0) if axis is None else source.vec3(axis.get("xyz"), f"{where} <axis>"),
        effort_nm=number(limit, "effort", math.inf),
        velocity_radps=number(limit, "velocity", math.inf),
        damping_nmspr=number(dynamics, "damping", 0.0),
        friction_nm=number(dynamics, "friction", 0.0),
        gear_ratio=gears.get(name, 1.0),
    )


def _gear_ratios(root: ET.Element, source: Source) -> dict[str, float]:
    """Motor turns per joint turn, by joint."""
    ratios = {}
    for transmission in root.findall("transmission"):
        joint = transmission.find("joint")
        reduction = transmission.find("actuator/mechanicalReduction")
        if joint is not None and reduction is not None:
            name = joint.get("name", "")
            ratios[name] = source.number(reduction.text, f"transmission of joint '{name}'")
    return ratios
