"""Tyres on soil: parameters of the force law that the kernel applies.

Normal force is a spring and damper, friction an elastic-plastic bristle per direction inside
an ellipse (Dahl 1968 with a Coulomb limit). While the wheel rolls, fresh tread takes the place of
what is stretched, z' = v - |rolling speed| z / L, as in the lumped tyre of Canudas de Wit, Tsiotras
and others (2003): without it coupled wheels stretch against each other. A convex contact solver
pushes sliding bodies apart, and a skid-steer vehicle slides whenever it turns: its yaw rate would
be wrong.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.robot import TyreSpec

ENVELOPE_SHARES = (-0.66, -0.33, 0.0, 0.33, 0.66)  # shares of the radius, along the tread
POINT_CONTACT = np.zeros((1, 3))


class Terrain(NamedTuple):
    """Bilinear grid over the ground, of heights or friction: rows along y, columns along x."""

    values: FloatArray
    x_min_m: float
    y_min_m: float
    resolution_m: float


class TyreLaw(NamedTuple):
    """Parameters of one tyre and its ground for the kernel; damping in N s/m.

    `envelope` (n, 3) are the points of the tread that feel the ground below a wheel: metres ahead
    and to the left of the hub, and how much higher than the lowest point the tread is there. With
    one point the tyre stands on the ground below its hub.
    """

    radius_m: float
    normal_stiffness_npm: float
    normal_damping_nspm: float
    bristle_stiffness_npm: float
    bristle_damping_nspm: float
    relaxation_length_m: float
    friction_longitudinal: float
    friction_lateral: float
    rolling_resistance: float
    ground_friction: Terrain
    envelope: FloatArray


def make_envelope(radius_m: float, width_m: float) -> FloatArray:
    """Make the points (n, 3) with which a tyre feels ground finer than its contact.

    A wheel rests on the highest of what lies under its tread, and bridges the hollows between:
    the rigid circle of Bekker and of Zegelaar's tandem cams.
    """
    points = [
        (share * radius_m, side * width_m / 4.0, radius_m * (1.0 - math.sqrt(1.0 - share**2)))
        for share in ENVELOPE_SHARES
        for side in (-1.0, 1.0)
    ]
    return np.array(points)


def make_tyre_law(
    tyre: TyreSpec,
    radius_m: float,
    mass_kg: float,
    wheel_mass_kg: float,
    ground_friction: Terrain,
    envelope: FloatArray = POINT_CONTACT,
    wheels: int = 4,
) -> TyreLaw:
    """Derive the force law; of tyre and ground the kernel takes the smaller friction."""
    load_kg = mass_kg / wheels
    return TyreLaw(
        radius_m=radius_m,
        normal_stiffness_npm=tyre.normal_stiffness_npm,
        normal_damping_nspm=2.0
        * tyre.normal_damping_ratio
        * math.sqrt(tyre.normal_stiffness_npm * load_kg),
        bristle_stiffness_npm=tyre.bristle_stiffness_npm,
        bristle_damping_nspm=math.sqrt(tyre.bristle_stiffness_npm * wheel_mass_kg / 2.0),
        relaxation_length_m=tyre.relaxation_length_m,
        friction_longitudinal=tyre.friction_longitudinal_ratio,
        friction_lateral=tyre.friction_lateral_ratio,
        rolling_resistance=tyre.rolling_resistance_ratio,
        ground_friction=ground_friction,
        envelope=envelope,
    )
