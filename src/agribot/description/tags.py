"""Plugin, sensor, contact and <agribot> tags of a URDF tree.

They are the only source of rates, noise and torque. Names are compared without case, because
descriptions in use spell them both ways.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import NamedTuple

from agribot.description.elements import SourceFile

Tags = dict[str, str]
DRIVE_PLUGINS = ("skid_steer", "skidsteer", "diff_drive", "diffdrive", "diff-drive")


class SensorKind(NamedTuple):
    """How descriptions name a sensor, and the rate of one that they leave out."""

    what: str
    plugins: tuple[str, ...]
    types: tuple[str, ...]
    words: tuple[str, ...]  # in the name of a link that is meant for it
    rate_hz: float
    is_optional: bool = False  # a robot without it is a good robot


IMU = SensorKind("IMU", ("ros_imu", "imu_sensor"), ("imu",), ("imu",), 100.0)
GNSS = SensorKind(
    "GNSS receiver", ("ros_gps", "navsat"), ("gps", "navsat"), ("gps", "gnss", "navsat"), 5.0
)
MAG = SensorKind(
    "magnetometer", ("ros_magnetic", "magnetometer"), ("magnetometer",), ("mag", "compass"), 10.0,
    is_optional=True,
)  # fmt: skip


class TagBlock:
    """The numbers inside one element; `what` names it in error messages."""

    def __init__(self, element: ET.Element, what: str, source: SourceFile, link: str = "") -> None:
        self.link = link  # link that the surrounding <gazebo reference> names
        self.what = what
        self.element = element
        self._source = source
        self.tags: Tags = {
            inner.tag.lower(): read_tag_value(inner) for inner in element if len(inner) == 0
        }

    def read_text(self, name: str) -> str:
        value = self.tags.get(name.lower())
        if value is None:
            raise self._source.fail(
                self.what, f"<{name}> is missing; it has: {', '.join(sorted(self.tags)) or 'none'}"
            )
        return value

    def read_number(self, name: str) -> float:
        return self._source.parse_number(self.read_text(name), f"{self.what} <{name}>")

    def read_friction(self, name: str) -> float:
        return self._source.parse_friction(self.read_text(name), f"{self.what} <{name}>")

    def read_positive(self, name: str) -> float:
        value = self.read_number(name)
        if value <= 0.0:
            raise self._source.fail(self.what, f"<{name}> is {value:g}; give a number above 0")
        return value


def read_tag_value(element: ET.Element) -> str:
    """Read a tag: `<mu1 value="1"/>` and `<mu1>1</mu1>` are the same, as for sdformat."""
    return (element.get("value") or element.text or "").strip()


def iterate_gazebo_blocks(root: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    """Yield the link of each <gazebo> block ("" for the whole robot), and the block."""
    for element in root.findall("gazebo"):
        yield element.get("reference", ""), element


def find_plugin(root: ET.Element, parts: tuple[str, ...], source: SourceFile) -> TagBlock | None:
    """Find the first plugin whose file name contains one of the parts."""
    for link, block in iterate_gazebo_blocks(root):
        for plugin in block.iter("plugin"):
            file = (plugin.get("filename", "") + " " + plugin.get("name", "")).lower()
            if any(part in file for part in parts):
                return TagBlock(plugin, f"plugin '{plugin.get('filename')}'", source, link)
    return None


def find_sensor(root: ET.Element, kinds: tuple[str, ...]) -> tuple[str, ET.Element] | None:
    """Find the first <sensor> of one of the types, with the link it is attached to."""
    for link, block in iterate_gazebo_blocks(root):
        for sensor in block.iter("sensor"):
            if sensor.get("type", "").lower() in kinds:
                return link, sensor
    return None


def list_plugin_names(root: ET.Element) -> str:
    """List plugins and sensors, for the message that another one is missing."""
    plugins = [plugin.get("filename", "?") for plugin in root.iter("plugin")]
    sensors = [f"sensor type {sensor.get('type', '?')}" for sensor in root.iter("sensor")]
    return ", ".join(plugins + sensors) or "none"


def collect_contact_tags(root: ET.Element, link: str, source: SourceFile) -> TagBlock:
    """Collect friction and stiffness that the <gazebo reference> blocks give a link."""
    merged = ET.Element("gazebo")
    for reference, block in iterate_gazebo_blocks(root):
        if reference == link:
            merged.extend(block)
    return TagBlock(merged, f"<gazebo reference='{link}'>", source, link)


def find_extra(root: ET.Element, group: str, source: SourceFile) -> TagBlock | None:
    """Find a group of numbers in the <agribot> block, which Gazebo ignores."""
    for extra in [*root.findall("gazebo/agribot"), *root.findall("agribot")]:
        element = extra.find(group)
        if element is not None:
            return TagBlock(element, f"<agribot><{group}>", source)
    return None


def list_extras(root: ET.Element) -> tuple[str, ...]:
    """Name all groups in the <agribot> blocks, each once."""
    extras = [*root.findall("gazebo/agribot"), *root.findall("agribot")]
    return tuple(dict.fromkeys(element.tag for extra in extras for element in extra))
