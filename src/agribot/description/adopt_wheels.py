"""Other people's robots: their base and their wheels under the names used here.

The tree is changed in place, so that export, recording and physics all see the same robot.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agribot.core.geo import inverse
from agribot.core.messages import MIDDLE_WHEEL_NAMES, WHEEL_NAMES, FloatArray
from agribot.core.robot import Joint, Link
from agribot.description.adopt_masses import (
    BASE,
    compute_axis_rpy,
    fix_inertias,
    format_numbers,
    give_wheel_mass,
)
from agribot.description.drive_kind import (
    Wheel,
    find_wheels,
    leave_driven,
    list_fixed_castors,
    pair_wheels,
)
from agribot.description.elements import SourceFile
from agribot.description.markup import PlacedElement
from agribot.description.mesh_bounds import measure_mesh_m
from agribot.description.package import find_package_folder
from agribot.description.poses import to_origin

BASE_WORDS = ("base", "chassis", "body", "base_footprint")
DEFAULT_RADIUS_M = 0.1
WIDTH_PER_RADIUS = 0.5
SAME_RADIUS_RATIO = 0.02


def make_names_unique(root: ET.Element, source: SourceFile) -> None:
    """Rename links and joints that repeat a name; references mean the first of them."""
    for kind in ("link", "joint"):
        seen: Counter[str] = Counter()
        for element in root.findall(kind):
            name = element.get("name", "")
            seen[name] += 1
            if seen[name] > 1:
                new = f"{name}_{seen[name] - 1}"
                element.set("name", new)
                source.warn(f"the {kind} name '{name}' is taken; this one is '{new}'", element)


def adopt_base(root: ET.Element, joints: Sequence[Joint], source: SourceFile) -> None:
    """Name the link that carries the wheels base_link, where no link has that name."""
    names = [link.get("name", "") for link in root.findall("link")]
    if BASE in names or not names:
        return
    parents = Counter(joint.parent for joint in joints if joint.kind == "continuous")
    named = [name for name in BASE_WORDS if name in names]
    carrier = (named or [name for name, _count in parents.most_common(1)] or names)[0]
    source.warn(f"there is no link '{BASE}'; '{carrier}' is taken for it")
    _rename(root, carrier, BASE)


def warn_of_loose_links(root: ET.Element, joints: Sequence[Joint], source: SourceFile) -> None:
    """Warn of links that nothing holds; the root of base_link needs no joint."""
    parents = {joint.child: joint.parent for joint in joints}
    top = BASE
    while top in parents:
        top = parents[top]
    for element in root.findall("link"):
        name = element.get("name", "")
        if name != top and name not in parents:
            source.warn(f"link '{name}' hangs on no joint; it is held where '{top}' is", element)


def adopt_wheels(
    root: ET.Element,
    links: Sequence[Link],
    joints: Sequence[Joint],
    source: SourceFile,
    folder: Path,
) -> None:
    """Name the wheels by their place, put them on base_link and give them size and mass.

    Raises: DescriptionError: there are no four wheels or more whose axles lie across the robot, or
        it drives otherwise.
    """
    poses = _compute_poses(links, joints)
    driven = leave_driven(root, find_wheels(joints, poses), joints, poses, source)
    wheels = _choose_wheels(root, driven, joints, source)
    named, radii_m = list(zip(_list_names(wheels), wheels, strict=True)), list[float]()
    for name, wheel in named:
        if wheel.joint.child != name:
            source.warn(f"link '{wheel.joint.child}' is taken for {name}, from its place")
        _mount(root, wheel, poses, source)
    for name, wheel in named:
        _rename(root, wheel.joint.child, f"{name}/new")
    for name, wheel in named:
        _rename(root, name, f"{name}_other")
        _rename(root, f"{name}/new", name)
        element = _find_named(root, "link", name)
        size = _give_cylinder(element, wheel, source, folder)
        if element.find("inertial") is None:
            give_wheel_mass(element, wheel.joint.axis, size, source)
        radii_m.append(size[0])
    _check_radii(wheels, radii_m, source)
    fix_inertias(root, source)


def list_middle_wheels(joints: Sequence[Joint]) -> tuple[str, ...]:
    """List the wheels between the corners of an adopted robot: right and left, rear first."""
    turning = {joint.child for joint in joints if joint.kind == "continuous"}
    groups = [names for names in MIDDLE_WHEEL_NAMES.values() if names and turning.issuperset(names)]
    return groups[0] if groups else ()


def _compute_poses(links: Sequence[Link], joints: Sequence[Joint]) -> dict[str, FloatArray]:
    """Return the pose of every link in base_link, (4, 4), with all joints at zero."""
    parents = {joint.child: joint for joint in joints}

    def root_from(name: str) -> FloatArray:
        pose, seen = np.eye(4), set()
        while name in parents and name not in seen:
            seen.add(name)
            pose = parents[name].origin.matrix() @ pose
            name = parents[name].parent
        return pose

    base_from_root = inverse(root_from(BASE))
    return {link.name: base_from_root @ root_from(link.name) for link in links}


def _choose_wheels(
    root: ET.Element, wheels: list[Wheel], joints: Sequence[Joint], source: SourceFile
) -> list[Wheel]:
    """Choose the wheels: the corners in the order of WHEEL_NAMES, then those between them."""
    own = {wheel.joint.child: wheel for wheel in wheels if wheel.joint.child in WHEEL_NAMES}
    if len(own) == len(wheels) == len(WHEEL_NAMES):
        return [own[name] for name in WHEEL_NAMES]
    pairs = pair_wheels(wheels)
    apart = len(wheels) >= len(WHEEL_NAMES) and all(
        left.centre_m[1] - right.centre_m[1] > 0.01 for right, left in pairs
    )
    if not apart or pairs[-1][0].centre_m[0] - pairs[0][0].centre_m[0] < 0.01:
        turning = [j.child for j in joints if j.kind not in {"fixed", "floating"}]
        castors = list_fixed_castors(root)
        raise source.fail(
            "wheels",
            "four wheel joints at the corners are needed, of type continuous and with their axles "
            f"along y of {BASE}; turning links: {', '.join(turning) or 'none'}"
            + (f"; castors: {', '.join(castors)}" if castors else ""),
        )
    return [wheel for pair in (pairs[0], pairs[-1], *pairs[1:-1]) for wheel in pair]


def _check_radii(wheels: Sequence[Wheel], radii_m: Sequence[float], source: SourceFile) -> None:
    """Refuse wheels between the corners that are not as large as those at the corners."""
    for wheel, radius_m in list(zip(wheels, radii_m, strict=True))[len(WHEEL_NAMES) :]:
        if abs(radius_m - radii_m[0]) > SAME_RADIUS_RATIO * radii_m[0]:
            raise source.fail(
                f"link '{wheel.joint.child}'",
                f"a wheel of {radius_m:g} m radius between wheels of {radii_m[0]:g} m; all wheels "
                "of a skid steer on more than four turn at the speed of their side; give them one "
                "radius",
            )


def _list_names(wheels: Sequence[Wheel]) -> tuple[str, ...]:
    return (*WHEEL_NAMES, *MIDDLE_WHEEL_NAMES[len(wheels) - len(WHEEL_NAMES)])


def _mount(
    root: ET.Element, wheel: Wheel, poses: dict[str, FloatArray], source: SourceFile
) -> None:
    """Turn a wheel's joint into a continuous one on base_link whose axis points to the left."""
    joint, element = wheel.joint, _find_named(root, "joint", wheel.joint.name)
    if joint.parent != BASE:
        parent = element.find("parent")
        if parent is not None:
            parent.set("link", BASE)
        origin = element.find("origin")
        if origin is None:
            origin = ET.SubElement(element, "origin")
        pose = to_origin(poses[joint.child])
        origin.set("xyz", format_numbers(pose.xyz_m))
        origin.set("rpy", format_numbers(pose.rpy_rad))
        source.warn(f"joint '{joint.name}' hangs on '{joint.parent}'; it is put on {BASE}", element)
    if joint.kind != "continuous":
        element.set("type", "continuous")
    if wheel.flipped:
        axis = element.find("axis")
        if axis is None:
            axis = ET.SubElement(element, "axis")
        axis.set("xyz", format_numbers([-value for value in joint.axis]))
        source.warn(
            f"joint '{joint.name}' turns backwards; its axis is turned round", element, quiet=True
        )


def _give_cylinder(
    element: ET.Element, wheel: Wheel, source: SourceFile, folder: Path
) -> tuple[float, float]:
    """Return radius and width of a wheel; add a collision cylinder if it has none."""
    cylinder = element.find("collision/geometry/cylinder")
    if cylinder is not None:
        where = f"link '{wheel.joint.child}' <cylinder>"
        return tuple(  # type: ignore[return-value]
            source.parse_number(cylinder.get(key), f"{where} {key}") for key in ("radius", "length")
        )
    radius_m, width_m, origin = _find_size(element, wheel, source, folder)
    source.warn(
        f"wheel '{wheel.joint.child}' collides with no cylinder; one of {radius_m:.4g} m radius "
        f"and {width_m:.4g} m width is used, {origin}",
        element,
    )
    collision = ET.SubElement(element, "collision")
    ET.SubElement(
        collision,
        "origin",
        {"xyz": "0 0 0", "rpy": format_numbers(compute_axis_rpy(wheel.joint.axis))},
    )
    geometry = ET.SubElement(collision, "geometry")
    size = {"radius": format_numbers([radius_m]), "length": format_numbers([width_m])}
    ET.SubElement(geometry, "cylinder", size)
    return radius_m, width_m


def _find_size(
    element: ET.Element, wheel: Wheel, source: SourceFile, folder: Path
) -> tuple[float, float, str]:
    """Return radius, width and where they come from."""
    where = f"link '{wheel.joint.child}'"
    for kind in ("collision", "visual"):
        for form in element.findall(f"{kind}/geometry/cylinder"):
            radius_m = source.parse_number(form.get("radius"), f"{where} <cylinder radius>")
            return radius_m, source.parse_number(form.get("length"), where), f"from its <{kind}>"
        for form in element.findall(f"{kind}/geometry/sphere"):
            radius_m = source.parse_number(form.get("radius"), f"{where} <sphere radius>")
            return radius_m, WIDTH_PER_RADIUS * radius_m, "from its sphere"
        for form in element.findall(f"{kind}/geometry/mesh"):
            file = _find_mesh_file(form.get("filename", ""), folder)
            bounds = None if file is None else measure_mesh_m(file)
            if bounds is not None:
                scale = np.array(source.parse_vec3(form.get("scale", "1 1 1"), where))
                extent = np.sort((bounds[1] - bounds[0]) * np.abs(scale))
                return float(extent[2]) / 2.0, float(extent[0]), "from its mesh"
    return DEFAULT_RADIUS_M, WIDTH_PER_RADIUS * DEFAULT_RADIUS_M, "a guess"


def _find_mesh_file(uri: str, folder: Path) -> Path | None:
    scheme, _, rest = uri.rpartition("://")
    if scheme in {"package", "model"}:
        package, _, inner = rest.partition("/")
        above = find_package_folder(package, folder / "robot.urdf")
        path = None if above is None else above / inner
    else:
        path = folder / rest
    return path if path is not None and path.is_file() else None


def _rename(root: ET.Element, old: str, new: str) -> None:
    """Rename a link, with all references to it."""
    for link in root.findall("link"):
        if link.get("name") == old:
            link.set("name", new)
    for end in [*root.findall("joint/parent"), *root.findall("joint/child")]:
        if end.get("link") == old:
            end.set("link", new)
    for block in root.findall("gazebo"):
        if block.get("reference") == old:
            block.set("reference", new)
        for element in block.iter():
            if element.tag.lower() == "bodyname" and (element.text or "").strip() == old:
                element.text = new


def _find_named(root: ET.Element, kind: str, name: str) -> ET.Element:
    found = next((e for e in root.findall(kind) if e.get("name") == name), None)
    return PlacedElement(kind, {"name": name}) if found is None else found
