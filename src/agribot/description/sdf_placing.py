"""Which models stand in a world, under which name and where."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from typing import NamedTuple

import numpy as np

from agribot.core.messages import FloatArray
from agribot.description.elements import Source
from agribot.description.markup import PlacedElement
from agribot.description.poses import read_pose
from agribot.description.sdf_library import ModelLibrary, kind_of
from agribot.description.sdf_models import surface_from_words, tag

SPAWN_FRAME = "robot_spawn"
DRIVES = ("skid_steer", "skidsteer", "diff_drive", "diff-drive", "diffdrive")
GROUND_WORDS = ("plane", "ground", "terrain", "field", "floor", "road", "heightmap")
GROUND_M = 100.0  # side of the square that stands in for a ground nobody has
# Kinds of things in a world that are neither models nor read elsewhere.
PASSED_OVER = ("actor", "population", "road")


class Standing(NamedTuple):
    """A model standing in a world, or included by it."""

    name: str
    kind: str
    element: ET.Element
    map_from_model: FloatArray


class _Found(NamedTuple):
    name: str
    kind: str
    element: ET.Element
    placed: ET.Element  # that holds the <pose>


class Placing:
    """Reads the models of one world."""

    def __init__(
        self, world: ET.Element, source: Source, library: ModelLibrary, map_from_world: FloatArray
    ) -> None:
        self._world, self._source, self._library = world, source, library
        self._map_from_world = map_from_world
        self._frames = {
            element.get("name", ""): element
            for kind in ("frame", "model")
            for element in world.findall(kind)
        }

    def spawn(self) -> FloatArray | None:
        """Where the world says that the robot starts, (4, 4) in the map."""
        frame = self._frames.get(SPAWN_FRAME)
        if frame is None:
            return None
        pose: FloatArray = self._map_from_world @ self._world_from(frame, SPAWN_FRAME)
        return pose

    def models(self) -> list[Standing]:
        """Models in the order of the file, each with a name of its own."""
        found = self._found()
        counts = Counter(model.name for model in found)
        states = self._states()
        seen: Counter[str] = Counter()
        taken = set(counts)
        models = []
        for model in found:
            number = seen[model.name]
            seen[model.name] += 1
            name = model.name
            if number:
                name = self._free_name(model, number, counts[model.name], taken)
            with self._source.attempt(model.placed):
                saved = states.get(model.name, [])
                if len(saved) == counts[model.name]:
                    world_from_model = saved[number]
                else:
                    world_from_model = self._world_from(model.placed, model.name)
                models.append(
                    Standing(
                        name, model.kind, model.element, self._map_from_world @ world_from_model
                    )
                )
        return models

    def _free_name(self, model: _Found, number: int, count: int, taken: set[str]) -> str:
        """A name that nobody has; the second of a kind tells the user, a check hears of all."""
        name = f"{model.name}_{number}"
        while name in taken:
            name += "_"
        taken.add(name)
        if number == 1:
            self._source.warn(
                f"{count} models are named '{model.name}'; all but the first got a number",
                model.placed,
            )
        else:
            self._source.warn(
                f"the name '{model.name}' is taken; this model is '{name}'",
                model.placed,
                quiet=True,
            )
        return name

    def _found(self) -> list[_Found]:
        found = []
        for element in [*self._world, *self._world.findall("state/insertions/model")]:
            with self._source.attempt(element):
                if element.tag == "model":
                    name = element.get("name", "model")
                    kind = element.findtext(tag("kind"), name)
                    found.append(_Found(name, kind, element, element))
                elif element.tag == "include":
                    found += self._included(element)
                elif element.tag in PASSED_OVER:
                    self._source.warn(
                        f"<{element.tag} name='{element.get('name', '')}'> is not read; left out"
                    )
        return found

    def _included(self, element: ET.Element) -> list[_Found]:
        uri = (element.findtext("uri") or "").strip()
        kind = kind_of(uri)
        if kind == "sun":
            return []
        model = self._library.find(uri)
        if model is None:
            model = self._stand_in(uri, kind)
        name = element.findtext("name") or model.get("name") or kind
        placed = element if element.find("pose") is not None else model
        return [_Found(name, kind, model, placed)]

    def _stand_in(self, uri: str, kind: str) -> ET.Element:
        """A box, or a piece of ground where the name speaks of one."""
        if any(word in kind.lower() for word in GROUND_WORDS):
            what, shape = "level ground", f"<plane><size>{GROUND_M} {GROUND_M}</size></plane>"
            pose, surface = "0 0 0", surface_from_words(kind)
        else:
            what, shape, pose, surface = "a box", "<box><size>1 1 1</size></box>", "0 0 0.5", ""
        self._source.warn(f"model '{uri}' is in no model folder; {what} stands in for it")
        model = PlacedElement("model", {"name": kind or "unnamed"})
        link = ET.SubElement(model, "link", {"name": "link"})
        part = ET.SubElement(link, "collision", {"name": "stand_in"})
        ET.SubElement(part, "pose").text = f"{pose} 0 0 0"
        geometry = ET.SubElement(part, "geometry")
        geometry.append(ET.fromstring(shape))
        if surface:
            ET.SubElement(part, tag("surface")).text = surface
        return model

    def _states(self) -> dict[str, list[FloatArray]]:
        """Poses of a saved <state>, which replace those of the models."""
        states: dict[str, list[FloatArray]] = {}
        for model in self._world.findall("state/model"):
            with self._source.attempt(model):
                if model.find("pose") is not None:
                    pose = read_pose(model, self._source, "<state>")
                    states.setdefault(model.get("name", ""), []).append(pose)
        return states

    def _world_from(self, element: ET.Element, name: str, depth: int = 8) -> FloatArray:
        """Pose of an element in the world, along the frames that it is relative to."""
        pose = read_pose(element, self._source, f"{element.tag} '{name}'")
        written = element.find("pose")
        relative = "" if written is None else written.get("relative_to", "")
        if not relative and element.tag == "frame":
            relative = element.get("attached_to", "")
        if relative in {"", "world"}:
            return pose
        base = self._frames.get(relative)
        if base is None or base is element or depth == 0:
            self._source.warn(
                f"'{name}' is placed relative to '{relative}', which is no frame of the world; "
                "its pose is taken as it stands"
            )
            return pose
        placed: FloatArray = np.asarray(self._world_from(base, relative, depth - 1) @ pose)
        return placed


def is_robot(model: ET.Element) -> bool:
    """Old worlds carry the robot itself; it is placed there and described elsewhere."""
    return any(
        word in (plugin.get("filename", "") + plugin.get("name", "")).lower()
        for plugin in model.iter("plugin")
        for word in DRIVES
    )
