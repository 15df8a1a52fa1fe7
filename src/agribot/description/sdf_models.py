"""What an SDF model is made of: solid shapes, ground surfaces and plants."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agribot.description.elements import Source
from agribot.description.kinematics import GREY, Rgba
from agribot.description.poses import origin_of, read_pose
from agribot.messages import FloatArray
from agribot.robot import Shape

NAMESPACE = "urn:agribot:sdf"
FLAT_M = 0.11  # boxes up to this thick count as ground when they name a surface
SURFACE_WORDS = {
    "soil": "soil", "field": "soil", "dirt": "soil", "grass": "grass", "pavement": "pavement",
    "tarmac": "pavement", "asphalt": "pavement", "road": "pavement", "grey": "pavement",
}  # fmt: skip


class Placed(NamedTuple):
    """A shape in the frame of its model; `collides` tells solid from merely visible."""

    shape: Shape
    collides: bool


class Patch(NamedTuple):
    """A rectangle of ground in the frame of its model."""

    surface: str
    model_from_patch: FloatArray
    size_m: tuple[float, float]
    visible: bool


class ModelParts(NamedTuple):
    shapes: tuple[Placed, ...]
    patches: tuple[Patch, ...]
    friction_ratio: float | None


class _Part(NamedTuple):
    """One <visual> or <collision>."""

    element: ET.Element
    model_from_part: FloatArray
    collides: bool


def tag(name: str) -> str:
    """The name of one of our own elements as the XML parser spells it."""
    return f"{{{NAMESPACE}}}{name}"


def read_parts(model: ET.Element, source: Source, warn: Callable[[str], None]) -> ModelParts:
    """All shapes and ground patches of a model, nested models included."""
    where = f"model '{model.get('name', '')}'"
    shapes: list[Placed] = []
    patches: list[Patch] = []
    friction: float | None = None
    for part in _parts(model, np.eye(4), source, where):
        form = _form(part.element, source, where)
        if form.tag == "plane" or _is_flat_ground(part, form, source, where):
            patches.append(_patch(part, form, source, where))
            friction = _friction(part.element, source, where) if part.collides else friction
        elif form.tag in {"box", "cylinder", "sphere"}:
            shapes.append(Placed(_shape(part, form, source, where), part.collides))
        else:
            warn(f"{where}: <{form.tag}> geometry is not read; the part is left out")
    return ModelParts(_merged(shapes), tuple(patches), friction)


def _parts(model: ET.Element, frame: FloatArray, source: Source, where: str) -> list[_Part]:
    found = []
    for link in model.findall("link"):
        model_from_link = frame @ read_pose(link, source, where)
        for kind in ("collision", "visual"):
            found += [
                _Part(part, model_from_link @ read_pose(part, source, where), kind == "collision")
                for part in link.findall(kind)
            ]
    for inner in model.findall("model"):
        found += _parts(inner, frame @ read_pose(inner, source, where), source, where)
    return found


def _form(part: ET.Element, source: Source, where: str) -> ET.Element:
    geometry = source.child(part, "geometry", where)
    if len(geometry) == 0:
        raise source.fail(where, f"<geometry> of '{part.get('name')}' is empty")
    return geometry[0]


def _is_flat_ground(part: _Part, form: ET.Element, source: Source, where: str) -> bool:
    if form.tag != "box" or part.element.find(tag("surface")) is None:
        return False
    return source.vec3(form.findtext("size"), where)[2] <= FLAT_M


def _patch(part: _Part, form: ET.Element, source: Source, where: str) -> Patch:
    text = form.findtext("size", "1 1")
    size = source.numbers(" ".join(text.split()[:2]), 2, f"{where} <{form.tag}> <size>")
    return Patch(
        _surface(part.element), part.model_from_part, (size[0], size[1]), not part.collides
    )


def _surface(part: ET.Element) -> str:
    """The surface that the element names, else one that its name or material suggests."""
    named = part.findtext(tag("surface"))
    if named:
        return named.strip()
    hints = [part.get("name", "")] + [script.text or "" for script in part.iter("name")]
    text = " ".join(hints).lower()
    return next((surface for word, surface in SURFACE_WORDS.items() if word in text), "soil")


def _friction(part: ET.Element, source: Source, where: str) -> float | None:
    """The smaller of the two friction coefficients of a contact surface."""
    ode = part.find("surface/friction/ode")
    if ode is None:
        return None
    return min(source.number(ode.findtext(key, "1"), f"{where} <{key}>") for key in ("mu", "mu2"))


def _shape(part: _Part, form: ET.Element, source: Source, where: str) -> Shape:
    origin = origin_of(part.model_from_part)
    rgba = _colour(part.element, source, where)
    if form.tag == "box":
        size = source.vec3(form.findtext("size"), f"{where} <box> <size>")
        return Shape(kind="box", size_m=size, origin=origin, rgba=rgba)
    radius_m = source.number(form.findtext("radius"), f"{where} <{form.tag}> <radius>")
    length_m = source.number(form.findtext("length", "0"), f"{where} <{form.tag}> <length>")
    return Shape(kind=form.tag, size_m=(radius_m, length_m, 0.0), origin=origin, rgba=rgba)


def _colour(part: ET.Element, source: Source, where: str) -> Rgba:
    text = part.findtext("material/diffuse") or part.findtext("material/ambient")
    if text is None:
        return GREY
    red, green, blue = source.numbers(" ".join(text.split()[:3]), 3, f"{where} <material>")
    return red, green, blue, 1.0


def _merged(shapes: list[Placed]) -> tuple[Placed, ...]:
    """One shape where a collision and a visual coincide: solid, in the colour of the visual."""

    def place(shape: Shape) -> tuple[object, ...]:
        return shape.kind, shape.size_m, shape.origin

    colours = {place(p.shape): p.shape for p in shapes if not p.collides}
    solid = {place(p.shape) for p in shapes if p.collides}
    return tuple(
        Placed(colours.get(place(p.shape), p.shape), p.collides)
        for p in shapes
        if p.collides or place(p.shape) not in solid
    )
