"""The models in a world, with their names and poses."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from typing import NamedTuple

from agribot.core.messages import FloatArray
from agribot.description.elements import SourceFile
from agribot.description.markup import PlacedElement
from agribot.description.poses import read_pose
from agribot.description.sdf_frames import FrameScope
from agribot.description.sdf_library import ModelLibrary, parse_kind
from agribot.description.sdf_models import guess_surface, qualify_tag

SPAWN_FRAME = "robot_spawn"
DRIVES = ("skid_steer", "skidsteer", "diff_drive", "diff-drive", "diffdrive")
GROUND_WORDS = ("plane", "ground", "terrain", "field", "floor", "road", "heightmap")
GROUND_M = 100.0  # side of the square in the place of an absent ground
# Kinds of things in a world that are neither models nor read elsewhere.
PASSED_OVER = ("population", "road")


class PlacedModel(NamedTuple):
    """A model in a world or included by it; `map_from_model` is (4, 4)."""

    name: str
    kind: str
    element: ET.Element
    map_from_model: FloatArray


class _FoundModel(NamedTuple):
    name: str
    kind: str
    element: ET.Element
    placed: ET.Element  # element that the world places: the model, or its <include>


class WorldModels:
    """Reads the models of one world."""

    def __init__(
        self,
        world: ET.Element,
        source: SourceFile,
        library: ModelLibrary,
        map_from_world: FloatArray,
    ) -> None:
        self._world, self._source, self._library = world, source, library
        self._map_from_world = map_from_world
        self._scope = FrameScope(world, source, library)

    def find_spawn(self) -> FloatArray | None:
        """Return the robot's start pose that the world states, (4, 4) in the map, or None."""
        if not any(frame.get("name") == SPAWN_FRAME for frame in self._world.findall("frame")):
            return None
        pose: FloatArray = self._map_from_world @ self._scope.find_frame(SPAWN_FRAME, "the start")
        return pose

    def list_models(self) -> list[PlacedModel]:
        """List the models in the order of the file, each with a unique name."""
        found = self._find_models()
        counts = Counter(model.name for model in found)
        states = self._read_states()
        seen: Counter[str] = Counter()
        taken = set(counts)
        models = []
        for model in found:
            number = seen[model.name]
            seen[model.name] += 1
            name = model.name
            if number:
                name = self._choose_free_name(model, number, counts[model.name], taken)
            with self._source.attempt(model.placed):
                saved = states.get(model.name, [])
                if len(saved) == counts[model.name]:
                    world_from_model = saved[number]
                else:
                    world_from_model = self._scope.find_pose(model.placed)
                models.append(
                    PlacedModel(
                        name, model.kind, model.element, self._map_from_world @ world_from_model
                    )
                )
        return models

    def _choose_free_name(
        self, model: _FoundModel, number: int, count: int, taken: set[str]
    ) -> str:
        """Choose a free name; the second of a kind warns the user, all show in a check."""
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

    def _find_models(self) -> list[_FoundModel]:
        found = []
        for element in [*self._world, *self._world.findall("state/insertions/model")]:
            with self._source.attempt(element):
                if element.tag == "model":
                    name = element.get("name", "model")
                    kind = element.findtext(qualify_tag("kind"), name)
                    found.append(_FoundModel(name, kind, element, element))
                elif element.tag == "include":
                    found += self._include(element)
                elif element.tag in PASSED_OVER:
                    self._source.warn(
                        f"<{element.tag} name='{element.get('name', '')}'> is not read; left out"
                    )
        return found

    def _include(self, element: ET.Element) -> list[_FoundModel]:
        uri = (element.findtext("uri") or "").strip()
        kind = parse_kind(uri)
        if kind == "sun":
            return []
        model = self._library.find(uri)
        name = element.findtext("name") or ""
        if model is None:
            model, name = self._library.find_of_kind(kind), name or kind
            if model is None:
                model = self._make_stand_in(uri, kind)
            else:
                kind = model.get("name", kind)
                self._source.warn(
                    f"model '{uri}' is in no model folder; the packaged '{kind}' stands in for it"
                )
        name = name or model.get("name") or kind
        return [_FoundModel(name, kind, model, element)]

    def _make_stand_in(self, uri: str, kind: str) -> ET.Element:
        """Make a box, or a piece of ground where the name suggests one."""
        if is_ground(kind):
            what, shape = "level ground", f"<plane><size>{GROUND_M} {GROUND_M}</size></plane>"
            pose, surface = "0 0 0", guess_surface(kind)
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
            ET.SubElement(part, qualify_tag("surface")).text = surface
        return model

    def _read_states(self) -> dict[str, list[FloatArray]]:
        """Read the poses of a saved <state>, which replace those of the models."""
        states: dict[str, list[FloatArray]] = {}
        for model in self._world.findall("state/model"):
            with self._source.attempt(model):
                if model.find("pose") is not None:
                    pose = read_pose(model, self._source, "<state>")
                    states.setdefault(model.get("name", ""), []).append(pose)
        return states


def is_ground(name: str) -> bool:
    """Return whether a name suggests a piece of ground."""
    return any(word in name.lower() for word in GROUND_WORDS)


def is_robot(model: ET.Element) -> bool:
    """Return whether a model is the robot itself, which old worlds contain."""
    return any(
        word in (plugin.get("filename", "") + plugin.get("name", "")).lower()
        for plugin in model.iter("plugin")
        for word in DRIVES
    )
