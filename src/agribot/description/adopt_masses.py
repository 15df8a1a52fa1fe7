"""Other people's robots: masses and inertias that are physically possible."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from agribot.core.messages import WHEEL_NAMES
from agribot.description.elements import SourceFile

BASE = "base_link"
WHEEL_KG, BASE_KG = 1.0, 15.0
GYRATION_M = 0.2  # radius of a base without an inertia


def give_wheel_mass(
    element: ET.Element, axis: Sequence[float], size_m: tuple[float, float], source: SourceFile
) -> None:
    """Give a wheel the mass and inertia of a solid cylinder; `size_m` is radius and width."""
    radius_m, width_m = size_m
    source.warn(
        f"wheel '{element.get('name')}' has no <inertial>; {WHEEL_KG:g} kg is used", element
    )
    across = WHEEL_KG * (3.0 * radius_m**2 + width_m**2) / 12.0
    turning = WHEEL_KG * radius_m**2 / 2.0
    _add_inertial(element, WHEEL_KG, (across, across, turning), compute_axis_rpy(axis))


def fix_inertias(root: ET.Element, source: SourceFile) -> None:
    """Give base_link a mass, and links an inertia that is physically possible."""
    base = next(link for link in root.findall("link") if link.get("name") == BASE)
    if base.find("inertial") is None and not _has_mass(root):
        source.warn(f"no link but the wheels has a mass; {BASE_KG:g} kg is used", base)
        _add_inertial(base, BASE_KG, (BASE_KG * GYRATION_M**2,) * 3, (0.0, 0.0, 0.0))
    for link in root.findall("link"):
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        if mass is None or inertia is None:
            continue
        where = f"link '{link.get('name')}'"
        with source.attempt(link):
            mass_kg = source.parse_number(mass.get("value"), f"{where} <mass>")
            xx, yy, zz, xy, xz, yz = (
                source.parse_number(inertia.get(key, "0"), f"{where} <inertia {key}>")
                for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            )
            low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            if mass_kg > 0.0 and (low <= 0.0 or low + middle < high * (1.0 - 1e-6)):
                source.warn(f"{where}: no body has this inertia; a ball's is used", inertia)
                for key in ("ixx", "iyy", "izz"):
                    inertia.set(key, format_numbers([0.4 * mass_kg * (GYRATION_M / 2.0) ** 2]))
                for key in ("ixy", "ixz", "iyz"):
                    inertia.set(key, "0")


def _has_mass(root: ET.Element) -> bool:
    return any(
        link.find("inertial") is not None and link.get("name") not in WHEEL_NAMES
        for link in root.findall("link")
    )


def _add_inertial(
    element: ET.Element, mass_kg: float, diagonal: Sequence[float], rpy_rad: Sequence[float]
) -> None:
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", {"xyz": "0 0 0", "rpy": format_numbers(rpy_rad)})
    ET.SubElement(inertial, "mass", {"value": format_numbers([mass_kg])})
    names = dict(zip(("ixx", "iyy", "izz"), (format_numbers([v]) for v in diagonal), strict=True))
    ET.SubElement(inertial, "inertia", {**names, "ixy": "0", "ixz": "0", "iyz": "0"})


def compute_axis_rpy(axis: Sequence[float]) -> tuple[float, float, float]:
    """Return the roll, pitch and yaw that turn the z axis onto an axis, rad."""
    x, y, z = axis
    return 0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)


def format_numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.12g}" for value in values)
