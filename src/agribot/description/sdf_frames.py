"""Frames of an SDF world or model: where an element is that is placed relative to another."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from agribot.core.geo import inverse
from agribot.core.messages import FloatArray
from agribot.description.elements import SourceFile
from agribot.description.poses import read_pose
from agribot.description.sdf_library import ModelLibrary, parse_kind

KINDS = ("frame", "link", "joint", "model", "include")
OWN = ("", "world", "__model__")  # names of the frame of the world or model itself


class FrameScope:
    """The frames inside one world or model, whose own frame poses are returned in."""

    def __init__(self, root: ET.Element, source: SourceFile, library: ModelLibrary) -> None:
        self._source, self._library = source, library
        self._where = f"{root.tag} '{root.get('name', '')}'"
        self._is_world = root.tag == "world"
        self._elements: dict[str, ET.Element] = {}
        self._open: set[ET.Element] = set()
        for kind in KINDS:
            for element in root.findall(kind):
                self._elements.setdefault(_name(element), element)

    def find_pose(self, element: ET.Element, parent: str = "") -> FloatArray:
        """Return `scope_from_element`, (4, 4); `parent` is the frame of a pose that names none.

        Raises: DescriptionError: there is no such frame, or frames are relative to each other.
        """
        name = _name(element)
        placed = element if element.find("pose") is not None else self._find_model(element)
        pose = None if placed is None else placed.find("pose")
        relative = "" if pose is None else self._read_relative(pose, name)
        if element in self._open:
            raise self._source.fail(
                self._where, f"'{name}' is placed relative to itself; name another frame"
            )
        self._open.add(element)
        try:
            frame = self.find_frame(relative or self._find_parent(element) or parent, name)
        finally:
            self._open.discard(element)
        if placed is None:
            return frame
        where = f"{element.tag} '{name}'" if self._is_world else self._where
        found: FloatArray = frame @ read_pose(placed, self._source, where)
        return found @ self._find_placement(element)

    def _read_relative(self, pose: ET.Element, user: str) -> str:
        """Return the frame that a pose names; in SDF 1.5 and 1.6 its attribute is `frame`.

        Programs of that time ignored a name that does not exist.
        """
        old = pose.get("frame", "")
        if old and old not in OWN and old.partition("::")[0] not in self._elements:
            self._source.warn(
                f"{self._where}: the pose of '{user}' names '{old}', which is no frame; it is "
                "taken as if it named none"
            )
            old = ""
        return pose.get("relative_to", "") or old

    def find_frame(self, name: str, user: str) -> FloatArray:
        """Return `scope_from_frame`, (4, 4), of a frame that `user` names."""
        if name in OWN:
            return np.eye(4)
        head, _, rest = name.partition("::")
        element = self._elements.get(head)
        inner = None if element is None else self._find_model(element)
        if element is None or (rest and inner is None):
            there = ", ".join(self._elements) or "none"
            raise self._source.fail(
                self._where,
                f"'{user}' is placed relative to '{name}', which is no frame; there are: {there}",
            )
        frame = self.find_pose(element)
        if rest and inner is not None:
            frame = frame @ FrameScope(inner, self._source, self._library).find_frame(rest, user)
        return frame

    def _find_model(self, element: ET.Element) -> ET.Element | None:
        """Return the model itself of a model or an include, None of anything else."""
        if element.tag == "include":
            return self._library.find((element.findtext("uri") or "").strip())
        return element if element.tag == "model" else None

    def _find_parent(self, element: ET.Element) -> str:
        """Return the frame that a frame or a joint is in if its pose names none."""
        if element.tag == "joint":
            return (element.findtext("child") or "").strip()
        return element.get("attached_to", "") if element.tag == "frame" else ""

    def _find_placement(self, element: ET.Element) -> FloatArray:
        """Return `placed_from_model`, (4, 4), where a model is placed by one of its frames."""
        model = self._find_model(element)
        name = element.findtext("placement_frame") or element.get("placement_frame", "")
        if model is None or not name:
            return np.eye(4)
        inside = FrameScope(model, self._source, self._library)
        return inverse(inside.find_frame(name, _name(element)))


def _name(element: ET.Element) -> str:
    if element.tag != "include":
        return element.get("name", "")
    return element.findtext("name") or parse_kind(element.findtext("uri") or "")
