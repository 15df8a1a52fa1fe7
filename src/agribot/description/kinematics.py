"""Links and joints of a URDF tree."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import TypeAlias

from agribot.core.robot import Joint, Link, Origin, Shape
from agribot.description.elements import SourceFile

Rgba: TypeAlias = tuple[float, float, float, float]

GREY: Rgba = (0.7, 0.7, 0.7, 1.0)


def read_links(root: ET.Element, source: SourceFile) -> tuple[Link, ...]:
    palette = read_palette(root, source)
    links = []
    for element in root.findall("link"):
        with source.attempt(element):
            links.append(_read_link(element, palette, source))
    return tuple(links)


def read_joints(root: ET.Element, source: SourceFile) -> tuple[Joint, ...]:
    """Read all joints.

    Raises: DescriptionError: a joint names a link that does not exist, or they make no tree.
    """
    gears = _read_gear_ratios(root, source)
    links = {element.get("name", "") for element in root.findall("link")}
    joints = []
    above: dict[str, Joint] = {}  # joints by the link that hangs on each
    for element in root.findall("joint"):
        with source.attempt(element):
            joint = _read_joint(element, gears, source)
            for end in (joint.parent, joint.child):
                if end not in links:
                    raise source.fail(
                        f"joint '{joint.name}'",
                        f"there is no link '{end}'; there are: {', '.join(sorted(links))}",
                    )
            _check_place(joint, above, source)
            above[joint.child] = joint
            joints.append(joint)
    return tuple(joints)


def _check_place(joint: Joint, above: Mapping[str, Joint], source: SourceFile) -> None:
    where = f"joint '{joint.name}'"
    if joint.child in above:
        raise source.fail(
            where,
            f"link '{joint.child}' hangs on joint '{above[joint.child].name}' already; leave one "
            "of them out",
        )
    name = joint.parent
    while name != joint.child and name in above:
        name = above[name].parent
    if name == joint.child:
        raise source.fail(
            where,
            f"link '{joint.parent}' would hang on itself; the links of a robot make a tree, so "
            "name another parent",
        )


def read_palette(root: ET.Element, source: SourceFile) -> dict[str, Rgba]:
    """Read the named colours of the robot."""
    palette = {}
    for material in root.iter("material"):
        color = material.find("color")
        if color is not None:
            palette[material.get("name", "")] = _read_rgba(color, source)
    return palette


def _read_rgba(color: ET.Element, source: SourceFile) -> Rgba:
    text = color.get("rgba") or ""
    if len(text.split()) == 3:
        source.warn(f"<color> '{text}' has no alpha; it is opaque", color, quiet=True)
        text += " 1"
    red, green, blue, alpha = source.parse_numbers(text, 4, "<color>")
    return red, green, blue, alpha


def _read_origin(element: ET.Element, source: SourceFile, where: str) -> Origin:
    origin = element.find("origin")
    if origin is None:
        return Origin()
    return Origin(
        xyz_m=source.parse_vec3(origin.get("xyz", "0 0 0"), f"{where} <origin xyz>"),
        rpy_rad=source.parse_vec3(origin.get("rpy", "0 0 0"), f"{where} <origin rpy>"),
    )


def _read_link(element: ET.Element, palette: dict[str, Rgba], source: SourceFile) -> Link:
    name = source.require_attribute(element, "name", "a link")
    where = f"link '{name}'"
    shapes = {
        tag: tuple(_read_shape(part, palette, source, where) for part in element.findall(tag))
        for tag in ("visual", "collision")
    }
    inertial = element.find("inertial")
    if inertial is None:
        return Link(name=name, visuals=shapes["visual"], collisions=shapes["collision"])
    mass = source.require_child(inertial, "mass", where)
    inertia = source.require_child(inertial, "inertia", where)
    ixx, iyy, izz, ixy, ixz, iyz = (
        source.parse_number(inertia.get(key, "0"), f"{where} <inertia {key}>")
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    return Link(
        name=name,
        mass_kg=source.parse_number(mass.get("value"), f"{where} <mass>"),
        com=_read_origin(inertial, source, where),
        inertia_kgm2=(ixx, iyy, izz, ixy, ixz, iyz),
        visuals=shapes["visual"],
        collisions=shapes["collision"],
    )


def _read_shape(
    part: ET.Element, palette: dict[str, Rgba], source: SourceFile, where: str
) -> Shape:
    geometry = source.require_child(part, "geometry", where)
    if len(geometry) == 0:
        raise source.fail(where, "<geometry> is empty; give it a box, cylinder, sphere or mesh")
    form = geometry[0]
    origin, rgba = _read_origin(part, source, where), _read_colour(part, palette, source)
    if form.tag == "box":
        size = source.parse_vec3(form.get("size"), f"{where} <box>")
        _check_size(part, size, f"{where} <box>", source)
        return Shape(kind="box", size_m=size, origin=origin, rgba=rgba)
    if form.tag == "mesh":
        scale = source.parse_vec3(form.get("scale", "1 1 1"), f"{where} <mesh>")
        file = source.require_attribute(form, "filename", where)
        return Shape(kind="mesh", size_m=scale, origin=origin, mesh=file, rgba=rgba)
    if form.tag not in {"cylinder", "sphere"}:
        raise source.fail(
            where, f"<{form.tag}> is not a shape; write box, cylinder, sphere or mesh"
        )
    radius_m = source.parse_number(form.get("radius"), f"{where} <{form.tag} radius>")
    length_m = source.parse_number(form.get("length", "0"), f"{where} <{form.tag} length>")
    sizes_m = (radius_m, length_m) if form.tag == "cylinder" else (radius_m,)
    _check_size(part, sizes_m, f"{where} <{form.tag}>", source)
    return Shape(kind=form.tag, size_m=(radius_m, length_m, 0.0), origin=origin, rgba=rgba)


def _check_size(
    part: ET.Element, sizes_m: tuple[float, ...], where: str, source: SourceFile
) -> None:
    """Refuse what has no room to touch anything; what is only seen may be of no size."""
    least_m = min(sizes_m)
    if least_m < 0.0 or (least_m == 0.0 and part.tag == "collision"):
        size = " x ".join(f"{size_m:g}" for size_m in sizes_m)
        raise source.fail(where, f"a size of {size} m; give it one above 0")


def _read_colour(part: ET.Element, palette: dict[str, Rgba], source: SourceFile) -> Rgba:
    material = part.find("material")
    if material is None:
        return GREY
    color = material.find("color")
    if color is not None:
        return _read_rgba(color, source)
    return palette.get(material.get("name", ""), GREY)


def _read_joint(element: ET.Element, gears: dict[str, float], source: SourceFile) -> Joint:
    name = source.require_attribute(element, "name", "a joint")
    where = f"joint '{name}'"
    axis, limit, dynamics = (element.find(tag) for tag in ("axis", "limit", "dynamics"))

    def read_number(part: ET.Element | None, key: str, default: float) -> float:
        text = None if part is None else part.get(key)
        return default if text is None else source.parse_number(text, f"{where} {key}")

    return Joint(
        name=name,
        kind=source.require_attribute(element, "type", where),
        parent=source.require_attribute(
            source.require_child(element, "parent", where), "link", where
        ),
        child=source.require_attribute(
            source.require_child(element, "child", where), "link", where
        ),
        origin=_read_origin(element, source, where),
        axis=(1.0, 0.0, 0.0)
        if axis is None
        else source.parse_vec3(axis.get("xyz"), f"{where} <axis>"),
        effort_nm=read_number(limit, "effort", math.inf),
        velocity_radps=read_number(limit, "velocity", math.inf),
        damping_nmspr=read_number(dynamics, "damping", 0.0),
        friction_nm=read_number(dynamics, "friction", 0.0),
        gear_ratio=gears.get(name, 1.0),
    )


def _read_gear_ratios(root: ET.Element, source: SourceFile) -> dict[str, float]:
    """Read the gear ratios, motor turns per joint turn, by joint."""
    ratios = {}
    for transmission in root.findall("transmission"):
        joint = transmission.find("joint")
        reduction = transmission.find("actuator/mechanicalReduction")
        if joint is not None and reduction is not None:
            name = joint.get("name", "")
            ratios[name] = source.parse_number(reduction.text, f"transmission of joint '{name}'")
    return ratios
