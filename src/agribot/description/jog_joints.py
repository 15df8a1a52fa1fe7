"""The joints of a robot that can be moved by steps: those with an end on both sides."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import NamedTuple

from agribot.description.loader import export_urdf

UNITS = {"revolute": "rad", "prismatic": "m"}


class JogJoint(NamedTuple):
    """A joint between `lower` and `upper`, rad or m as `unit` says; its speed is in that a second.

    `velocity` is infinite where the description does not limit it.
    """

    name: str
    unit: str
    lower: float
    upper: float
    velocity: float


def read_jog_joints(robot: str) -> dict[str, JogJoint]:
    """Read the revolute and prismatic joints of a packaged robot, URDF or xacro, by name.

    Raises: DescriptionError: no such robot, or one that cannot be read.
    """
    found = {}
    for element in ET.fromstring(export_urdf(robot)).findall("joint"):
        limit = element.find("limit")
        kind, name = element.get("type", ""), element.get("name", "")
        if kind in UNITS and limit is not None:
            lower, upper = (float(limit.get(key, "0")) for key in ("lower", "upper"))
            velocity = float(limit.get("velocity", "inf")) or math.inf
            if lower < upper:
                found[name] = JogJoint(name, UNITS[kind], lower, upper, velocity)
    return found
