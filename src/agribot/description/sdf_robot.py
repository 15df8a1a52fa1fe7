"""A robot in SDF as the URDF tree that says the same: links, joints, frames, sensors, plugins.

The link of a joint moves into the joint's frame, where URDF has it; what it holds is moved back.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from agribot.core.geo import inverse
from agribot.core.messages import FloatArray
from agribot.description.elements import SourceFile
from agribot.description.markup import copy_tree, read_xml
from agribot.description.poses import read_pose, to_origin
from agribot.description.sdf_frames import OWN, FrameScope
from agribot.description.sdf_library import ModelLibrary

ENDLESS = 1e12  # value from which on a limit counts as absent, as in Gazebo's files
SAME_PLACE = 1e-6  # m, and of the axes, between a sensor and a frame
KINDS = ("continuous", "revolute", "prismatic", "fixed")
INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
# Their sizes as attributes of URDF, each with the tag of SDF.
SHAPES: dict[str, tuple[tuple[str, str], ...]] = {
    "box": (("size", "size"),),
    "cylinder": (("radius", "radius"), ("length", "length")),
    "sphere": (("radius", "radius"),),
    "mesh": (("filename", "uri"), ("scale", "scale")),
}


def read_sdf_robot(path: Path, source: SourceFile) -> ET.Element:
    """Read the model of an SDF file as a URDF tree.

    Raises: DescriptionError: the file is broken, has no model or several, or holds what a robot
        cannot be made of.
    """
    root = read_xml(path)
    models = root.findall("model")
    if root.tag != "sdf" or len(models) != 1:
        raise source.fail(
            f"<{root.tag}>", f"{len(models)} models; a robot is an <sdf> with one <model> in it"
        )
    return _Model(models[0], source, ModelLibrary(path)).convert()


class _Model:
    def __init__(self, model: ET.Element, source: SourceFile, library: ModelLibrary) -> None:
        self._model, self._source = model, source
        self._scope = FrameScope(model, source, library)
        self._links = {_name(link): link for link in model.findall("link")}
        self._joints = [j for j in model.findall("joint") if self._text(j, "parent") not in OWN]
        above = {self._text(joint, "child"): joint for joint in self._joints}
        self._frames = {  # model_from_frame of the URDF link
            name: self._scope.find_pose(above.get(name, link)) for name, link in self._links.items()
        }
        self._urdf = ET.Element("robot", {"name": model.get("name", "robot")})

    def convert(self) -> ET.Element:
        """Make the tree.

        Raises: DescriptionError: models inside the model, no link, or an unknown joint type or
            parent.
        """
        for tag in ("model", "include"):
            if self._model.find(tag) is not None:
                raise self._source.fail(
                    f"model '{_name(self._model)}'",
                    f"a <{tag}> in it; robots are read of one model alone, so put its links here",
                )
        if not self._links:
            raise self._source.fail(f"model '{_name(self._model)}'", "no <link>; a robot has some")
        for name, link in self._links.items():
            self._add_link(name, link)
        for joint in self._joints:
            self._add_joint(joint)
        for frame in self._model.findall("frame"):
            self._add_frame(frame)
        plugins = ET.SubElement(self._urdf, "gazebo")
        plugins.extend(copy_tree(plugin) for plugin in self._model.findall("plugin"))
        return self._urdf

    def _add_link(self, name: str, link: ET.Element) -> None:
        urdf = ET.SubElement(self._urdf, "link", {"name": name})
        moved = inverse(self._frames[name]) @ self._scope.find_pose(link)
        where = f"link '{name}'"
        inertial = link.find("inertial")
        if inertial is not None:
            self._add_inertial(ET.SubElement(urdf, "inertial"), inertial, moved, where)
        for tag in ("collision", "visual"):
            for part in link.findall(tag):
                self._add_shape(urdf, part, moved, where)
        self._add_gazebo(name, link, moved, where)

    def _add_inertial(
        self, urdf: ET.Element, inertial: ET.Element, moved: FloatArray, where: str
    ) -> None:
        _add_origin(urdf, moved @ read_pose(inertial, self._source, where))
        ET.SubElement(urdf, "mass", {"value": self._text(inertial, "mass", "1")})
        values = {key: self._text(inertial, f"inertia/{key}", "0") for key in INERTIA}
        ET.SubElement(urdf, "inertia", values)

    def _add_shape(self, urdf: ET.Element, part: ET.Element, moved: FloatArray, where: str) -> None:
        forms = [form for form in part.iterfind("geometry/*") if form.tag in SHAPES]
        if not forms:
            kinds = ", ".join(form.tag for form in part.iterfind("geometry/*")) or "nothing"
            self._source.warn(f"{where}: a {part.tag} of {kinds} is left out", part)
            return
        element = ET.SubElement(urdf, part.tag, {"name": _name(part)})
        _add_origin(element, moved @ read_pose(part, self._source, where))
        sizes = {
            key: text for key, tag in SHAPES[forms[0].tag] if (text := self._text(forms[0], tag))
        }
        ET.SubElement(ET.SubElement(element, "geometry"), forms[0].tag, sizes)
        if colour := self._text(part, "material/diffuse"):
            material = ET.SubElement(element, "material", {"name": f"colour of {_name(part)}"})
            ET.SubElement(material, "color", {"rgba": colour})

    def _add_gazebo(self, name: str, link: ET.Element, moved: FloatArray, where: str) -> None:
        """Keep sensors and friction, which URDF has in blocks of Gazebo."""
        block = ET.Element("gazebo", {"reference": name})
        for sensor in link.findall("sensor"):
            copied = copy_tree(sensor)
            link_from_sensor = moved @ read_pose(sensor, self._source, where)
            for pose in copied.findall("pose"):
                copied.remove(pose)
            frame = self._find_frame_at(self._frames[name] @ link_from_sensor)
            if frame:
                ET.SubElement(self._urdf, "gazebo", {"reference": frame}).append(copied)
                continue
            place = to_origin(link_from_sensor)
            ET.SubElement(copied, "pose").text = _format(*place.xyz_m, *place.rpy_rad)
            block.append(copied)
        for tag, key in (("mu1", "mu"), ("mu2", "mu2")):
            if text := self._text(link, f"collision/surface/friction/ode/{key}"):
                ET.SubElement(block, tag).text = text
        if len(block):
            self._urdf.append(block)

    def _find_frame_at(self, model_from_sensor: FloatArray) -> str:
        """Find the frame at a sensor's pose; return an empty string without one."""
        for frame in self._model.findall("frame"):
            if _name(frame) not in self._links and np.allclose(
                self._scope.find_pose(frame), model_from_sensor, atol=SAME_PLACE
            ):
                return _name(frame)
        return ""

    def _add_joint(self, joint: ET.Element) -> None:
        name, where = _name(joint), f"joint '{_name(joint)}'"
        parent, child = self._text(joint, "parent"), self._text(joint, "child")
        for end in (parent, child):
            if end not in self._links:
                raise self._source.fail(
                    where, f"there is no link '{end}'; there are: {', '.join(sorted(self._links))}"
                )
        kind = self._find_kind(joint, where)
        urdf = ET.SubElement(self._urdf, "joint", {"name": name, "type": kind})
        _add_origin(urdf, inverse(self._frames[parent]) @ self._frames[child])
        ET.SubElement(urdf, "parent", {"link": parent})
        ET.SubElement(urdf, "child", {"link": child})
        if kind != "fixed":
            self._add_axis(urdf, joint, where)

    def _find_kind(self, joint: ET.Element, where: str) -> str:
        kind = joint.get("type", "")
        if kind not in KINDS:
            raise self._source.fail(
                where, f"it is of type '{kind}'; robots are read with {', '.join(KINDS)} joints"
            )
        if kind != "revolute":
            return kind
        ends = [self._text(joint, f"axis/limit/{end}") for end in ("lower", "upper")]
        limits = [self._read_limit(end, where) for end in ends if end]
        is_free = len(limits) < len(ends) or min(limits) == math.inf
        return "continuous" if is_free else kind

    def _add_axis(self, urdf: ET.Element, joint: ET.Element, where: str) -> None:
        text = self._text(joint, "axis/xyz", "0 0 1")
        axis = np.array(self._source.parse_vec3(text, f"{where} <axis>"))
        element = joint.find("axis/xyz")
        frame = "" if element is None else element.get("expressed_in", "")
        if frame:
            model_from_axis = self._scope.find_frame(frame, _name(joint))
            model_from_joint = self._frames[self._text(joint, "child")]
            axis = model_from_joint[:3, :3].T @ model_from_axis[:3, :3] @ axis
        ET.SubElement(urdf, "axis", {"xyz": _format(*axis.tolist())})
        limits = {}
        for key in ("lower", "upper", "effort", "velocity"):
            value = self._text(joint, f"axis/limit/{key}")
            if value and self._read_limit(value, where) < math.inf:
                limits[key] = value
        if limits:
            ET.SubElement(urdf, "limit", limits)
        keys = ("damping", "friction")
        found = {key: self._text(joint, f"axis/dynamics/{key}", "0") for key in keys}
        if joint.find("axis/dynamics") is not None:
            ET.SubElement(urdf, "dynamics", found)

    def _read_limit(self, text: str, where: str) -> float:
        """Read the size of a limit; what is endless is infinite."""
        try:
            size = abs(float(text))
        except ValueError:
            size = math.nan
        if size >= ENDLESS:
            return math.inf
        return abs(self._source.parse_number(text, f"{where} <limit>"))

    def _add_frame(self, frame: ET.Element) -> None:
        """Make a link without mass of a frame, fixed to the link that it is attached to."""
        name = _name(frame)
        if name in self._links:
            return
        carrier = self._find_carrier(frame)
        ET.SubElement(self._urdf, "link", {"name": name})
        joint = ET.SubElement(self._urdf, "joint", {"name": f"{name}_joint", "type": "fixed"})
        _add_origin(joint, inverse(self._frames[carrier]) @ self._scope.find_pose(frame))
        ET.SubElement(joint, "parent", {"link": carrier})
        ET.SubElement(joint, "child", {"link": name})

    def _find_carrier(self, frame: ET.Element) -> str:
        """Find the link under a frame; that of the model's own frame is its first one."""
        above = {_name(one): one.get("attached_to", "") for one in self._model.findall("frame")}
        above |= {_name(joint): self._text(joint, "child") for joint in self._joints}
        name, seen = frame.get("attached_to", ""), set[str]()
        while name in above and name not in seen:
            seen.add(name)
            name = above[name]
        if name in OWN:
            return next(iter(self._links))
        if name not in self._links:
            raise self._source.fail(
                f"frame '{_name(frame)}'", f"it is attached to '{name}'; name a link"
            )
        return name

    def _text(self, element: ET.Element, path: str, default: str = "") -> str:
        return " ".join((element.findtext(path) or "").split()) or default


def _name(element: ET.Element) -> str:
    return element.get("name", "")


def _add_origin(element: ET.Element, pose: FloatArray) -> None:
    origin = to_origin(pose)
    ET.SubElement(
        element, "origin", {"xyz": _format(*origin.xyz_m), "rpy": _format(*origin.rpy_rad)}
    )


def _format(*values: float) -> str:
    return " ".join(f"{0.0 if abs(value) < 1e-12 else value:.12g}" for value in values)
