"""Worlds: from a name or an SDF file to a WorldSpec in the map frame."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agribot.description.elements import Source
from agribot.description.package import world_files
from agribot.description.poses import level, origin_of, read_pose, yaw_of
from agribot.description.scatter import Crop, grow, read_crop, read_weed_areas
from agribot.description.sdf_header import Header
from agribot.description.sdf_library import ModelLibrary, is_crop_with_weed, read_sdf
from agribot.description.sdf_models import ModelParts, Patch, read_parts
from agribot.errors import DescriptionError
from agribot.messages import FloatArray
from agribot.robot import Shape
from agribot.world import GroundTile, Obstacle, WorldSpec

SPAWN_FRAME = "robot_spawn"


class _Model(NamedTuple):
    """A model standing in a world, or included by it."""

    name: str
    kind: str
    element: ET.Element
    map_from_model: FloatArray


def world_names() -> list[str]:
    return sorted(world_files())


def load_world(
    name_or_path: str, *, seed: int = 0, weed_density_per_m2: float | None = None
) -> WorldSpec:
    """Read a packaged world or a .world or .sdf file, and let its plants grow.

    The same file, seed and density give the same plants. What is odd but harmless in the file
    (repeated names, models nobody has) ends up in `warnings`.

    Raises: DescriptionError: unknown name, broken file, or a world without ground.
    """
    path = _world_path(name_or_path)
    return _WorldReader(path).read(seed, weed_density_per_m2)


def _world_path(name_or_path: str) -> Path:
    known = world_files()
    if name_or_path in known:
        return known[name_or_path]
    path = Path(name_or_path)
    if path.suffix in {".world", ".sdf"}:
        return path
    raise DescriptionError(
        f"unknown world '{name_or_path}'; known: {', '.join(sorted(known))}, "
        "or a path to a .world or .sdf file"
    )


class _WorldReader:
    """One reading of one file: what it has collected so far."""

    def __init__(self, path: Path) -> None:
        self._source = Source(path.name)
        self._library = ModelLibrary(path)
        self._warnings: Counter[str] = Counter()
        root = read_sdf(path)
        world = root.find("world")
        if world is None:
            has = ", ".join(f"<{inner.tag}>" for inner in root) or "nothing"
            raise self._source.fail("SDF", f"there is no <world>; the file has {has}")
        self._world = world
        self._header = Header(world, self._source, self._warn)
        self._map_from_world = self._header.map_from_world

    def read(self, seed: int, weed_density_per_m2: float | None) -> WorldSpec:
        spawn = self._spawn_frame()
        crops: list[Crop] = []
        obstacles: list[Obstacle] = []
        patches: list[tuple[FloatArray, Patch]] = []
        friction: list[float] = []
        for model in self._models():
            if _is_robot(model.element):
                spawn = model.map_from_model if spawn is None else spawn
                continue
            crop = self._crop(model)
            if crop is not None:
                crops.append(crop)
                continue
            parts = read_parts(model.element, self._source, self._warn)
            obstacles += _obstacles(model, parts)
            patches += [(model.map_from_model, patch) for patch in parts.patches]
            friction += [] if parts.friction_ratio is None else [parts.friction_ratio]
        areas = read_weed_areas(self._world, self._source)
        plants = grow(crops, areas, self._map_from_world, seed, weed_density_per_m2)
        where = np.eye(4) if spawn is None else spawn
        return WorldSpec(
            name=self._world.get("name", ""),
            datum=self._header.datum,
            spawn_xy_map_m=(float(where[0, 3]), float(where[1, 3])),
            spawn_yaw_map_rad=yaw_of(where),
            gravity_mps2=self._header.gravity_mps2,
            field_enu_t=self._header.field_enu_t,
            friction_ratio=min(friction, default=1.0),
            light=self._header.light,
            ground=self._ground(patches),
            plants=plants,
            obstacles=tuple(obstacles),
            warnings=tuple(
                text if times == 1 else f"{text} ({times} times)"
                for text, times in self._warnings.items()
            ),
        )

    def _warn(self, text: str) -> None:
        self._warnings[text] += 1

    def _spawn_frame(self) -> FloatArray | None:
        for frame in self._world.findall("frame"):
            if frame.get("name") == SPAWN_FRAME:
                pose: FloatArray = self._map_from_world @ read_pose(
                    frame, self._source, f"frame '{SPAWN_FRAME}'"
                )
                return pose
        return None

    def _models(self) -> list[_Model]:
        """Models in the order of the file, each with a name of its own."""
        found = []
        for element in self._world:
            if element.tag == "model":
                found.append((element.get("name", "model"), "", element, element))
            elif element.tag == "include":
                found += self._included(element)
        counts = Counter(name for name, _kind, _model, _pose in found)
        taken: Counter[str] = Counter()
        models = []
        states = self._states()
        for name, kind, model, placed in found:
            unique = name if taken[name] == 0 else f"{name}_{taken[name]}"
            taken[name] += 1
            world_from_model = read_pose(placed, self._source, f"model '{name}'")
            if counts[name] == 1 and name in states:
                world_from_model = states[name]
            models.append(
                _Model(unique, kind or name, model, self._map_from_world @ world_from_model)
            )
        for name, count in counts.items():
            if count > 1:
                self._warn(f"{count} models are named '{name}'; all but the first got a number")
        return models

    def _included(self, element: ET.Element) -> list[tuple[str, str, ET.Element, ET.Element]]:
        uri = (element.findtext("uri") or "").strip()
        kind = uri.removeprefix("model://").strip("/")
        if kind == "sun":
            return []
        model = self._library.find(uri)
        if model is None:
            self._warn(f"model '{uri}' is not in any model folder; it is left out")
            return []
        name = element.findtext("name") or model.get("name") or kind
        return [(name, kind, model, element if element.find("pose") is not None else model)]

    def _states(self) -> dict[str, FloatArray]:
        """Poses of a saved <state>, which replace those of the models."""
        return {
            model.get("name", ""): read_pose(model, self._source, "<state>")
            for model in self._world.findall("state/model")
        }

    def _crop(self, model: _Model) -> Crop | None:
        x_m, y_m = model.map_from_model[:2, 3].tolist()
        crop = read_crop(model.element, x_m, y_m, self._source)
        if crop is None and (is_crop_with_weed(model.kind) or is_crop_with_weed(model.name)):
            ours = self._library.find("model://crop_with_weed")
            crop = None if ours is None else read_crop(ours, x_m, y_m, self._source)
        return crop

    def _ground(self, patches: list[tuple[FloatArray, Patch]]) -> tuple[GroundTile, ...]:
        """What is seen of the ground; where nothing is to be seen, what is felt."""
        if not patches:
            raise self._source.fail(
                "ground", "the world has no ground; add a model with a <plane>, see empty.world"
            )
        visible = [pair for pair in patches if pair[1].visible] or patches
        return tuple(self._tile(frame, patch) for frame, patch in visible)

    def _tile(self, map_from_model: FloatArray, patch: Patch) -> GroundTile:
        half = np.array(patch.size_m) / 2.0
        corners = np.array(
            [[x, y, 0.0, 1.0] for x in (-half[0], half[0]) for y in (-half[1], half[1])]
        )
        map_from_patch = map_from_model @ patch.model_from_patch
        at_m = (map_from_patch @ corners.T)[:2]
        if min(abs(map_from_patch[0, 0]), abs(map_from_patch[1, 0])) > 1e-3:
            self._warn(
                f"{patch.surface} ground is not laid East to North; its bounding box is used"
            )
        x_min, y_min, x_max, y_max = np.round((*at_m.min(axis=1), *at_m.max(axis=1)), 9).tolist()
        return GroundTile(
            surface=patch.surface, x_min_m=x_min, y_min_m=y_min, x_max_m=x_max, y_max_m=y_max
        )


def _is_robot(model: ET.Element) -> bool:
    """Old worlds carry the robot itself; it is placed there and described elsewhere."""
    return any("skid_steer" in plugin.get("filename", "") for plugin in model.iter("plugin"))


def _obstacles(model: _Model, parts: ModelParts) -> list[Obstacle]:
    """The solid part of a model, and apart from it what is only to be seen."""
    yaw_rad = yaw_of(model.map_from_model)
    tilt = level(-yaw_rad) @ model.map_from_model
    tilt[:3, 3] = 0.0
    upright = bool(np.allclose(tilt, np.eye(4), atol=1e-12))
    x_m, y_m, z_m = model.map_from_model[:3, 3].tolist()

    def shapes(collides: bool) -> tuple[Shape, ...]:
        chosen = [placed.shape for placed in parts.shapes if placed.collides == collides]
        return tuple(shape if upright else _tilted(shape, tilt) for shape in chosen)

    return [
        Obstacle(
            name=model.name if collides else f"{model.name}/visual",
            kind=model.kind,
            x_map_m=x_m,
            y_map_m=y_m,
            z_map_m=z_m,
            yaw_rad=yaw_rad,
            shapes=shapes(collides),
            collides=collides,
        )
        for collides in (True, False)
        if shapes(collides)
    ]


def _tilted(shape: Shape, tilt: FloatArray) -> Shape:
    return Shape(
        kind=shape.kind,
        size_m=shape.size_m,
        origin=origin_of(tilt @ shape.origin.matrix()),
        mesh=shape.mesh,
        rgba=shape.rgba,
    )
