"""The parts of an SDF model: solid shapes, ground surfaces and terrain."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.core.geo import transform
from agribot.core.messages import FloatArray, Vec3
from agribot.core.robot import Origin, Shape
from agribot.description.elements import SourceFile
from agribot.description.kinematics import GREY, Rgba
from agribot.description.mesh_bounds import read_mesh_points
from agribot.description.mesh_ground import PlacedMesh
from agribot.description.plant_names import (
    HEIGHT_LIMITS_M,
    MOST_SIDE_M,
    NamedPlant,
    find_plant_name,
)
from agribot.description.poses import to_origin
from agribot.description.sdf_forms import FORMS
from agribot.description.sdf_frames import FrameScope
from agribot.description.sdf_library import ModelLibrary, parse_mesh_folder

NAMESPACE = "urn:agribot:sdf"
FLAT_M = 0.11  # boxes up to this thick count as ground when they name a surface
MAX_DEPTH = 8  # depth of models that include models
STAND_IN_M = (1.0, 1.0, 1.0)  # size of the box in place of an absent mesh of scale 1
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


class PlacedShape(NamedTuple):
    """A shape in the frame of its model: solid if it `collides`, else only visible."""

    shape: Shape
    collides: bool


class Patch(NamedTuple):
    """A rectangle of ground in the frame of its model; a visible one is not solid."""

    surface: str
    model_from_patch: FloatArray
    size_m: tuple[float, float]
    visible: bool
    friction_ratio: float


class HeightMap(NamedTuple):
    """A height map: its element, and the pose (4, 4) of its middle in the frame of the model."""

    element: ET.Element
    model_from_relief: FloatArray
    visible: bool
    friction_ratio: float


class ModelParts(NamedTuple):
    shapes: tuple[PlacedShape, ...]
    patches: tuple[Patch, ...]
    reliefs: tuple[HeightMap, ...]
    plants: tuple[NamedPlant, ...]
    meshes: tuple[PlacedMesh, ...]

    @property
    def has_ground(self) -> bool:
        return bool(self.patches or self.reliefs)

    def leave_out(self, box: Shape) -> ModelParts:
        """Return the parts without the box of a mesh, as collision and as visual."""
        place = box.kind, box.size_m, box.origin
        kept = [
            part
            for part in self.shapes
            if (part.shape.kind, part.shape.size_m, part.shape.origin) != place
        ]
        return self._replace(shapes=tuple(kept))


class _Part(NamedTuple):
    """One <visual> or <collision>."""

    element: ET.Element
    model_from_part: FloatArray
    collides: bool


def measure_side_m(shapes: Sequence[PlacedShape]) -> float:
    """Measure the longer side in plan of what stands in a model, m, without its turns."""
    spans = []
    for shape in (part.shape for part in shapes):
        x_m, y_m = shape.origin.xyz_m[:2]
        half = (
            [side / 2.0 for side in shape.size_m[:2]]
            if shape.kind == "box"
            else [shape.size_m[0]] * 2
        )
        spans.append((x_m - half[0], x_m + half[0], y_m - half[1], y_m + half[1]))
    if not spans:
        return 0.0
    west, east, south, north = np.array(spans).T
    return float(max(east.max() - west.min(), north.max() - south.min()))


def qualify_tag(name: str) -> str:
    """Return the name of one of our own elements in the spelling of the XML parser."""
    return f"{{{NAMESPACE}}}{name}"


def read_parts(model: ET.Element, source: SourceFile, library: ModelLibrary) -> ModelParts:
    """Read all shapes, ground patches and height maps of a model, nested models included."""
    return _ModelReader(model, source, library).read()


class _ModelReader:
    def __init__(self, model: ET.Element, source: SourceFile, library: ModelLibrary) -> None:
        self._model, self._source, self._library = model, source, library
        self._where = f"model '{model.get('name', '')}'"
        self._shapes: list[PlacedShape] = []
        self._patches: list[Patch] = []
        self._reliefs: list[HeightMap] = []
        self._plants: dict[tuple[float, float], NamedPlant] = {}
        self._meshes: list[PlacedMesh] = []
        self._stood_in: set[tuple[ET.Element, bool, Origin]] = set()

    def read(self) -> ModelParts:
        meshes = []
        for part in self._collect_parts(self._model, np.eye(4), MAX_DEPTH):
            with self._source.attempt(part.element):
                form = self._find_form(part.element)
                if form.tag == "mesh":
                    meshes.append((part, form))
                else:
                    self._take_part(part, form)
        for part, form in meshes:
            with self._source.attempt(part.element):
                self._take_mesh(part, form)
        return ModelParts(
            _merge_shapes(self._shapes), tuple(self._patches), tuple(self._reliefs),
            tuple(self._plants.values()), tuple(self._meshes),
        )  # fmt: skip

    def _collect_parts(self, model: ET.Element, frame: FloatArray, depth: int) -> list[_Part]:
        """Collect the parts of a model that stands at `frame`, (4, 4), and of those in it."""
        found: list[_Part] = []
        scope = FrameScope(model, self._source, self._library)
        for link in model.findall("link"):
            for kind in ("collision", "visual"):
                for part in link.findall(kind):
                    with self._source.attempt(part):
                        pose = frame @ scope.find_pose(part, link.get("name", ""))
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
            with self._source.attempt(at):
                pose = frame @ scope.find_pose(at)
                found += self._collect_parts(inner, pose, max(depth - 1, 0))
        return found

    def _find_form(self, part: ET.Element) -> ET.Element:
        geometry = self._source.require_child(part, "geometry", self._where)
        if len(geometry) == 0:
            raise self._source.fail(
                self._where, f"<geometry> of '{part.get('name')}' is empty; give it a shape"
            )
        return geometry[0]

    def _take_part(self, part: _Part, form: ET.Element) -> None:
        if form.tag == "plane" or self._is_flat_ground(part, form):
            self._patches.append(self._read_patch(part, form))
        elif form.tag == "heightmap":
            friction_ratio = self._read_friction(part)
            relief = HeightMap(form, part.model_from_part, not part.collides, friction_ratio)
            self._reliefs.append(relief)
        elif form.tag in {"box", "cylinder", "sphere"}:
            self._shapes.append(PlacedShape(self._read_shape(part, form), part.collides))
        elif form.tag in FORMS:
            what, shapes = FORMS[form.tag](form, part.model_from_part, self._source, self._where)
            self._source.warn(f"{self._where}: <{form.tag}> is taken as {what}")
            rgba = self._read_colour(part.element)
            self._shapes += [
                PlacedShape(msgspec.structs.replace(shape, rgba=rgba), part.collides)
                for shape in shapes
            ]
        elif form.tag != "empty":
            self._source.warn(
                f"{self._where}: <{form.tag}> geometry is not read; the part is left out"
            )

    def _take_mesh(self, part: _Part, form: ET.Element) -> None:
        """Add a box of the mesh's size; without the mesh a packaged model, else a guess."""
        uri = (form.findtext("uri") or "").strip()
        file = self._library.find_file(uri)
        corners_m = None if file is None else read_mesh_points(file)
        scale = self._source.parse_vec3(form.findtext("scale", "1 1 1"), f"{self._where} <scale>")
        if corners_m is not None:
            corners_m = corners_m * np.array(scale)
        if self._take_plant(part, uri, corners_m):
            return
        bounds = None if corners_m is None else (corners_m.min(axis=0), corners_m.max(axis=0))
        packaged = self._library.find_stand_in(uri) if bounds is None else None
        if packaged is not None:
            self._add_stand_in(part, uri, packaged)
            return
        rgba = self._read_colour(part.element)
        words = f"{self._model.get('name', '')} {uri}"
        if bounds is not None and corners_m is not None:
            low, high = bounds
            x, y, z = ((low + high) / 2.0).tolist()
            shape = _make_box(
                (high - low).tolist(), part.model_from_part @ transform((x, y, z)), rgba
            )
            self._source.warn(f"{self._where}: mesh '{uri}' is taken as a box of its size")
            self._shapes.append(PlacedShape(shape, part.collides))
            placed_m = corners_m @ part.model_from_part[:3, :3].T + part.model_from_part[:3, 3]
            self._meshes.append(PlacedMesh(words, placed_m, shape))
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
            box = _make_box(size, lifted, rgba)
            self._shapes.append(PlacedShape(box, part.collides))
            self._meshes.append(PlacedMesh(words, np.zeros((0, 3)), box))

    def _take_plant(self, part: _Part, uri: str, corners_m: FloatArray | None) -> bool:
        """Take a mesh as a plant where its name or its model's speaks of one, and it is no row."""
        name = find_plant_name(uri) or find_plant_name(self._model.get("name", ""))
        sides_m = np.zeros(3) if corners_m is None else np.ptp(corners_m, axis=0)
        if name is None or max(sides_m[:2]) > MOST_SIDE_M:
            return False
        middle = np.zeros(3) if corners_m is None else corners_m.mean(axis=0)
        x_m, y_m, _ = (part.model_from_part[:3, :3] @ middle + part.model_from_part[:3, 3]).tolist()
        height_m = name.height_m if corners_m is None else float(sides_m[2])
        self._plants.setdefault(
            (round(x_m, 2), round(y_m, 2)),
            NamedPlant(name, (x_m, y_m), float(np.clip(height_m, *HEIGHT_LIMITS_M))),
        )
        return True

    def _add_stand_in(self, part: _Part, uri: str, packaged: ET.Element) -> None:
        """Add the solid shapes of a packaged model for a collision, the visible for a visual.

        Only once at one place: a tree's bark and leaves are two visuals with the same mesh.
        """
        place = packaged, part.collides, to_origin(part.model_from_part)
        if place in self._stood_in:
            return
        if not any(packaged is known for known, _, _ in self._stood_in):
            self._source.warn(
                f"the meshes of 'model://{parse_mesh_folder(uri)}' are not on this machine; the "
                f"packaged '{packaged.get('name')}' stands in"
            )
        self._stood_in.add(place)
        for ours in self._collect_parts(packaged, part.model_from_part, 0):
            if ours.collides == part.collides:
                self._take_part(ours, self._find_form(ours.element))

    def _is_flat_ground(self, part: _Part, form: ET.Element) -> bool:
        if form.tag != "box" or part.element.find(qualify_tag("surface")) is None:
            return False
        return self._source.parse_vec3(form.findtext("size"), self._where)[2] <= FLAT_M

    def _read_patch(self, part: _Part, form: ET.Element) -> Patch:
        text = form.findtext("size", "1 1")
        size = self._source.parse_numbers(
            " ".join(text.split()[:2]), 2, f"{self._where} <{form.tag}> <size>"
        )
        return Patch(
            surface=_find_surface(part.element),
            model_from_patch=part.model_from_part,
            size_m=(size[0], size[1]),
            visible=not part.collides,
            friction_ratio=self._read_friction(part),
        )

    def _read_friction(self, part: _Part) -> float:
        """Read the smaller of a surface's two friction coefficients, 1 without any."""
        ode = part.element.find("surface/friction/ode")
        if ode is None:
            return 1.0
        return min(
            self._source.parse_friction(ode.findtext(key, "1"), f"{self._where} <{key}>")
            for key in ("mu", "mu2")
        )

    def _read_shape(self, part: _Part, form: ET.Element) -> Shape:
        source, where = self._source, self._where
        rgba = self._read_colour(part.element)
        if form.tag == "box":
            size = source.parse_vec3(form.findtext("size"), f"{where} <box> <size>")
            return _make_box(list(size), part.model_from_part, rgba)
        radius_m = source.parse_number(form.findtext("radius"), f"{where} <{form.tag}> <radius>")
        length_m = source.parse_number(
            form.findtext("length", "0"), f"{where} <{form.tag}> <length>"
        )
        origin = to_origin(part.model_from_part)
        return Shape(kind=form.tag, size_m=(radius_m, length_m, 0.0), origin=origin, rgba=rgba)

    def _read_colour(self, part: ET.Element) -> Rgba:
        text = part.findtext("material/diffuse") or part.findtext("material/ambient")
        if text is not None:
            red, green, blue = self._source.parse_numbers(
                " ".join(text.split()[:3]), 3, f"{self._where} <material>"
            )
            return red, green, blue, 1.0
        name = (part.findtext("material/script/name") or "").strip()
        known = MATERIALS.get(name.rpartition("/")[2].lower())
        if name and known is None:
            self._source.warn(f"material '{name}' is not known; plain grey is used")
        return known or GREY


def _find_surface(part: ET.Element) -> str:
    """Return the surface that the element names, else one that its name or material suggests."""
    named = part.findtext(qualify_tag("surface"))
    if named:
        return named.strip()
    hints = [part.get("name", "")] + [script.text or "" for script in part.iter("name")]
    return guess_surface(" ".join(hints))


def guess_surface(text: str) -> str:
    """Return the surface that a name suggests; soil where it suggests none."""
    words = text.lower()
    return next((surface for word, surface in SURFACE_WORDS.items() if word in words), "soil")


def _make_box(size: list[float], model_from_box: FloatArray, rgba: Rgba) -> Shape:
    x, y, z = (max(side, 1e-3) for side in size)
    extent: Vec3 = (x, y, z)
    return Shape(kind="box", size_m=extent, origin=to_origin(model_from_box), rgba=rgba)


def _merge_shapes(shapes: list[PlacedShape]) -> tuple[PlacedShape, ...]:
    """Merge a collision and a visual that coincide: solid, in the colour of the visual."""

    def place(shape: Shape) -> tuple[object, ...]:
        return shape.kind, shape.size_m, shape.origin

    colours = {place(p.shape): p.shape for p in shapes if not p.collides}
    solid = {place(p.shape) for p in shapes if p.collides}
    return tuple(
        PlacedShape(colours.get(place(p.shape), p.shape), p.collides)
        for p in shapes
        if p.collides or place(p.shape) not in solid
    )
