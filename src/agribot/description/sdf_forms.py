"""Forms of SDF that physics and camera do not have, as forms that they have."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np

from agribot.core.geo import transform
from agribot.core.messages import FloatArray, Vec3
from agribot.core.robot import Shape
from agribot.description.elements import SourceFile
from agribot.description.poses import to_origin

# Reader of a form from its element, `model_from_form` (4, 4), its file and a name for errors.
ReadForm = Callable[[ET.Element, FloatArray, SourceFile, str], tuple[str, list[Shape]]]


def _read_number(form: ET.Element, tag: str, source: SourceFile, where: str) -> float:
    where = f"{where} <{form.tag}> <{tag}>"
    value_m = source.parse_number(form.findtext(tag), where)
    if value_m <= 0.0:
        raise source.fail(where, f"a size of {value_m:g} m; give it one above 0")
    return value_m


def _make(kind: str, size_m: Vec3, pose: FloatArray, at_m: Vec3 = (0.0, 0.0, 0.0)) -> Shape:
    return Shape(kind=kind, size_m=size_m, origin=to_origin(pose @ transform(at_m)))


def _read_capsule(
    form: ET.Element, pose: FloatArray, source: SourceFile, where: str
) -> tuple[str, list[Shape]]:
    radius_m, length_m = (_read_number(form, tag, source, where) for tag in ("radius", "length"))
    ends = [
        _make("sphere", (radius_m, 0.0, 0.0), pose, (0.0, 0.0, sign * length_m / 2.0))
        for sign in (-1.0, 1.0)
    ]
    return "a cylinder and two spheres", [_make("cylinder", (radius_m, length_m, 0.0), pose), *ends]


def _read_cone(
    form: ET.Element, pose: FloatArray, source: SourceFile, where: str
) -> tuple[str, list[Shape]]:
    radius_m, length_m = (_read_number(form, tag, source, where) for tag in ("radius", "length"))
    return "the cylinder around it", [_make("cylinder", (radius_m, length_m, 0.0), pose)]


def _read_ellipsoid(
    form: ET.Element, pose: FloatArray, source: SourceFile, where: str
) -> tuple[str, list[Shape]]:
    radii_m = source.parse_vec3(form.findtext("radii"), f"{where} <ellipsoid> <radii>")
    if min(radii_m) <= 0.0:
        raise source.fail(f"{where} <ellipsoid> <radii>", f"{radii_m}; all must be above 0")
    x_m, y_m, z_m = (2.0 * radius_m for radius_m in radii_m)
    return "the box around it", [_make("box", (x_m, y_m, z_m), pose)]


def _read_polyline(
    form: ET.Element, pose: FloatArray, source: SourceFile, where: str
) -> tuple[str, list[Shape]]:
    """Read a ground plan and its height; the form stands on the plane of its frame."""
    height_m = _read_number(form, "height", source, where)
    named = f"{where} <polyline> <point>"
    corners_m = np.array([source.parse_numbers(p.text, 2, named) for p in form.findall("point")])
    if len(corners_m) < 3 or np.ptp(corners_m, axis=0).min() <= 0.0:
        raise source.fail(named, f"{len(corners_m)} points that span no area; give three or more")
    x_m, y_m = ((corners_m.min(axis=0) + corners_m.max(axis=0)) / 2.0).tolist()
    size_m = (*np.ptp(corners_m, axis=0).tolist(), height_m)
    return "the box around it", [_make("box", size_m, pose, (x_m, y_m, height_m / 2.0))]


FORMS: dict[str, ReadForm] = {
    "capsule": _read_capsule,
    "cone": _read_cone,
    "ellipsoid": _read_ellipsoid,
    "polyline": _read_polyline,
}
