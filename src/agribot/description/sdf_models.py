"""What an SDF model is made of: solid shapes, ground surfaces and terrain."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np

from agribot.core.geo import transform
from agribot.core.messages import FloatArray, Vec3
from agribot.core.robot import Origin, Shape
from agribot.description.elements import Source
from agribot.description.kinematics import GREY, Rgba
from agribot.description.mesh_bounds import mesh_bounds_m
from agribot.description.poses import origin_of, read_pose
from agribot.description.sdf_library import ModelLibrary, mesh_folder

NAMESPACE = "urn:agribot:sdf"
FLAT_M = 0.11  # boxes up to this thick count as ground when they name a surface
MAX_DEPTH = 8  # of models that include models
STAND_IN_M = (1.0, 1.0, 1.0)  # of a mesh that nobody has and a scale of 1
SURFACE_WORDS = {
    "soil": "soil", "field": "soil", "dirt": "soil", "grass": "grass", "pavement": "pavement",
    "tarmac": "pavement", "asphalt": "pavement", "road": "pavement", "grey": "pavement",
}  # fmt: skip
# Names in Gazebo's own material script.
MATERIALS: dict[str, Rgba] = {
    "grey": (0.5, 0.5, 0.5, 1.0), "darkgrey": (0.2, 0.2, 0.2, 1.0), "white": (1.0, 1.0, 1.0, 1.0),
    "black": (0.05, 0.05, 0.05, 1.0), "red": (0.8, 0.1, 0.1, 1.0), "green": (0.1, 0.6, 0.1, 1.0),
    "blue": (0.1, 0.1, 0.8, 1.0), "yellow": (0.8, 0.8, 0.1, 1.0), "orange": (0.9, 0.5, 0.1, 1.0),
    "wood": (0.6, 0.45, 0.3, 1.0), "grass": (0.3, 0.45, 0.2, 1.0), "road": (0.3, 0.3, 0.3, 1.0),
}  # fmt: skip


class Placed(NamedTuple):
    """A shape in the frame of its model; `collides` tells solid from merely visible."""

    shape: Shape
    collides: bool


class Patch(NamedTuple):
    """A rectangle of ground in the frame of its model; one that is visible is not felt."""

    surface: str
    model_from_patch: FloatArray
    size_m: tuple[float, float]
    visible: bool
    friction_ratio: float


class Relief(NamedTuple):
    """A height map: the element, and where its middle lies in the frame of the model."""

    element: ET.Element
    model_from_relief: FloatArray
    visible: bool
    friction_ratio: float


class ModelParts(NamedTuple):
    shapes: tuple[Placed, ...]
    patches: tuple[Patch, ...]
    reliefs: tuple[Relief, ...]


class _Part(NamedTuple):
    """One <visual> or <collision>."""

    element: ET.Element
    model_from_part: FloatArray
    collides: bool


def tag(name: str) -> str:
    """The name of one of our own elements as the XML parser spells it."""
    return f"{{{NAMESPACE}}}{name}"


def read_parts(model: ET.Element, source: Source, library: ModelLibrary) -> ModelParts:
    """All shapes, ground patches and height maps of a model, nested models included."""
    return _ModelReader(model, source, library).read()


class _ModelReader:
    def __init__(self, model: ET.Element, source: Source, library: ModelLibrary) -> None:
        self._model, self._source, self._library = model, source, library
        self._where = f"model '{model.get('name', '')}'"
        self._shapes: list[Placed] = []
        self._patches: list[Patch] = []
        self._reliefs: list[Relief] = []
        self._stood_in: set[tuple[ET.Element, bool, Origin]] = set()

    def read(self) -> ModelParts:
        meshes = []
        for part in self._parts(self._model, np.eye(4), MAX_DEPTH):
            with self._source.attempt(part.element):
                form = self._form(part.element)
                if form.tag == "mesh":
                    meshes.append((part, form))
                else:
                    self._take(part, form)
        for part, form in meshes:
            with self._source.attempt(part.element):
                self._take_mesh(part, form)
        return ModelParts(_merged(self._shapes), tuple(self._patches), tuple(self._reliefs))

    def _parts(self, model: ET.Element, frame: FloatArray, depth: int) -> list[_Part]:
        found: list[_Part] = []
        for link in model.findall("link"):
            model_from_link = frame @ read_pose(link, self._source, self._where)
            for kind in ("collision", "visual"):
                for part in link.findall(kind):
                    with self._source.attempt(part):
                        pose = model_from_link @ read_pose(part, self._source, self._where)
                        found.append(_Part(part, pose, kind == "collision"))
        inside = [(inner, inner) for inner in model.findall("model")]
        for include in model.findall("include") if depth else ():
            uri = (include.findtext("uri") or "").strip()
            named = self._library.find(uri)
            if named is None:
                self._source.warn(f"{self._where}: '{uri}' is in no model folder; it is left out")
            else:
                inside.append((named, include))
        for inner, at in inside:
            pose = frame @ read_pose(at, self._source, self._where)
            found += self._parts(inner, pose, max(depth - 1, 0))
        return found

    def _form(self, part: ET.Element) -> ET.Element:
        geometry = self._source.child(part, "geometry", self._where)
        if len(geometry) == 0:
            raise self._source.fail(
                self._where, f"<geometry> of '{part.get('name')}' is empty; give it a shape"
            )
        return geometry[0]

    def _take(self, part: _Part, form: ET.Element) -> None:
        if form.tag == "plane" or self._is_flat_ground(part, form):
            self._patches.append(self._patch(part, form))
        elif form.tag == "heightmap":
            friction_ratio = self._friction_of(part)
            relief = Relief(form, part.model_from_part, not part.collides, friction_ratio)
            self._reliefs.append(relief)
        elif form.tag in {"box", "cylinder", "sphere"}:
            self._shapes.append(Placed(self._shape(part, form), part.collides))
        elif form.tag != "empty":
            self._source.warn(
                f"{self._where}: <{form.tag}> geometry is not read; the part is left out"
            )

    def _take_mesh(self, part: _Part, form: ET.Element) -> None:
        """A box as large as the mesh; without the mesh a packaged model, else a guess."""
        uri = (form.findtext("uri") or "").strip()
        file = self._library.file(uri)
        bounds = None if file is None else mesh_bounds_m(file)
        packaged = self._library.stand_in(uri) if bounds is None else None
        if packaged is not None:
            self._stand_in(part, uri, packaged)
            return
        scale = self._source.vec3(form.findtext("scale", "1 1 1"), f"{self._where} <scale>")
        rgba = self._colour(part.element)
        if bounds is not None:
            low, high = (corner * np.array(scale) for corner in bounds)
            x, y, z = ((low + high) / 2.0).tolist()
            shape = _box((high - low).tolist(), part.model_from_part @ transform((x, y, z)), rgba)
            self._source.warn(f"{self._where}: mesh '{uri}' is taken as a box of its size")
            self._shapes.append(Placed(shape, part.collides))
        elif self._shapes:
            self._source.warn(
                f"{self._where}: <mesh> '{uri}' is not on this machine; the part is left out"
            )
        else:
            self._source.warn(
                f"{self._where}: <mesh> '{uri}' is not on this machine; a box stands in for it"
            )
            size = [unit * abs(ratio) for unit, ratio in zip(STAND_IN_M, scale, strict=True)]
            lifted = part.model_from_part @ transform((0.0, 0.0, size[2] / 2.0))
            self._shapes.append(Placed(_box(size, lifted, rgba), part.collides))

    def _stand_in(self, part: _Part, uri: str, packaged: ET.Element) -> None:
        """What collides of a packaged model for a collision, what is seen of it for a visual.

        Once at one place: a tree's bark and leaves are two visuals with the same mesh.
        """
        place = packaged, part.collides, origin_of(part.model_from_part)
        if place in self._stood_in:
            return
        if not any(packaged is known for known, _, _ in self._stood_in):
            self._source.warn(
                f"the meshes of 'model://{mesh_folder(uri)}' are not on this machine; the "
                f"packaged '{packaged.get('name')}' stands in"
            )
        self._stood_in.add(place)
        for ours in self._parts(packaged, part.model_from_part, 0):
            if ours.collides == part.collides:
                self._take(ours, self._form(ours.element))

    def _is_flat_ground(self, part: _Part, form: ET.Element) -> bool:
        if form.tag != "box" or part.element.find(tag("surface")) is None:
            return False
        return self._source.vec3(form.findtext("size"), self._where)[2] <= FLAT_M

    def _patch(self, part: _Part, form: ET.Element) -> Patch:
        text = form.findtext("size", "1 1")
        size = self._source.numbers(
            " ".join(text.split()[:2]), 2, f"{self._where} <{form.tag}> <size>"
        )
        return Patch(
            surface=_surface(part.element),
            model_from_patch=part.model_from_part,
            size_m=(size[0], size[1]),
            visible=not part.collides,
            friction_ratio=self._friction_of(part),
        )

    def _friction_of(self, part: _Part) -> float:
        """The smaller of the two friction coefficients of a surface, which are 1 if not told."""
        ode = part.element.find("surface/friction/ode")
        if ode is None:
            return 1.0
        return min(
            self._source.number(ode.findtext(key, "1"), f"{self._where} <{key}>")
            for key in ("mu", "mu2")
        )

    def _shape(self, part: _Part, form: ET.Element) -> Shape:
        source, where = self._source, self._where
        rgba = self._colour(part.element)
        if form.tag == "box":
            size = source.vec3(form.findtext("size"), f"{where} <box> <size>")
            return _box(list(size), part.model_from_part, rgba)
        radius_m = source.number(form.findtext("radius"), f"{where} <{form.tag}> <radius>")
        length_m = source.number(form.findtext("length", "0"), f"{where} <{form.tag}> <length>")
        origin = origin_of(part.model_from_part)
        return Shape(kind=form.tag, size_m=(radius_m, length_m, 0.0), origin=origin, rgba=rgba)

    def _colour(self, part: ET.Element) -> Rgba:
        text = part.findtext("material/diffuse") or part.findtext("material/ambient")
        if text is not None:
            red, green, blue = self._source.numbers(
                " ".join(text.split()[:3]), 3, f"{self._where} <material>"
            )
            return red, green, blue, 1.0
        name = (part.findtext("material/script/name") or "").strip()
        known = MATERIALS.get(name.rpartition("/")[2].lower())
        if name and known is None:
            self._source.warn(f"material '{name}' is not known; plain grey is used")
        return known or GREY


def _surface(part: ET.Element) -> str:
    """The surface that the element names, else one that its name or material suggests."""
    named = part.findtext(tag("surface"))
    if named:
        return named.strip()
    hints = [part.get("name", "")] + [script.text or "" for script in part.iter("name")]
    return surface_from_words(" ".join(hints))


def surface_from_words(text: str) -> str:
    """The surface that a name suggests; soil where it suggests none."""
    words = text.lower()
    return next((surface for word, surface in SURFACE_WORDS.items() if word in words), "soil")


def _box(size: list[float], model_from_box: FloatArray, rgba: Rgba) -> Shape:
    x, y, z = (max(side, 1e-3) for side in size)
    extent: Vec3 = (x, y, z)
    return Shape(kind="box", size_m=extent, origin=origin_of(model_from_box), rgba=rgba)


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
