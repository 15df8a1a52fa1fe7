"""Tyres on soil: parameters of the force law that the kernel applies.

Normal force is a spring and damper, friction an elastic-plastic bristle per direction inside
an ellipse (Dahl 1968 with a Coulomb limit). A convex contact solver pushes sliding bodies
apart, and a skid-steer vehicle slides whenever it turns: its yaw rate would be wrong.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from agribot.messages import FloatArray
from agribot.robot import TyreSpec


class TyreLaw(NamedTuple):
    """What the kernel needs of one tyre; damping in N s/m."""

    radius_m: float
    normal_stiffness_npm: float
    normal_damping_nspm: float
    bristle_stiffness_npm: float
    bristle_damping_nspm: float
    friction_longitudinal: float
    friction_lateral: float
    rolling_resistance: float


class Terrain(NamedTuple):
    """Bilinear height grid: rows along y, columns along x."""

    height_m: FloatArray
    x_min_m: float
    y_min_m: float
    resolution_m: float


def tyre_law(
    tyre: TyreSpec, radius_m: float, mass_kg: float, wheel_mass_kg: float, ground_friction: float
) -> TyreLaw:
    """Dampers relative to critical ones; friction is the smaller of wheel and ground."""
    load_kg = mass_kg / 4.0
    return TyreLaw(
        radius_m=radius_m,
        normal_stiffness_npm=tyre.normal_stiffness_npm,
        normal_damping_nspm=2.0
        * tyre.normal_damping_ratio
        * math.sqrt(tyre.normal_stiffness_npm * load_kg),
        bristle_stiffness_npm=tyre.bristle_stiffness_npm,
        bristle_damping_nspm=math.sqrt(tyre.bristle_stiffness_npm * wheel_mass_kg / 2.0),
        friction_longitudinal=min(tyre.friction_longitudinal_ratio, ground_friction),
        friction_lateral=min(tyre.friction_lateral_ratio, ground_friction),
        rolling_resistance=tyre.rolling_resistance_ratio,
    )
