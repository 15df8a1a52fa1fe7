"""How a plant looks that does not stand any more: flat on the ground, and darker with time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.core.messages import Vec3
from agribot.sim.camera.arrays import Singles

CRUSHED_RATIO = 0.12  # share of the height that is left
CUT_RATIO = 0.35  # the same of a plant out of the ground, looser than one that was rolled over
LEAN_RATIO = 0.7  # distance of its top ahead of its foot, in heights
# Factors of red, green and blue. Torn leaves are wet and full of soil; above 1 stands for the light
# that a pressed mesh lacks, whose normals are those of the upright one.
BRUISED = (1.45, 1.30, 1.20)
WILTED = (1.30, 0.90, 0.85)
WILTING_S = 1800.0  # time from bruised to wilted, in the sun
LOOK_STEP_S = 60.0


class LyingPlant(NamedTuple):
    """`plant` is its index in the world; its top lies in direction `way_rad`.

    `up` is the normal of the ground below it, `age_s` the time since it fell.
    """

    plant: int
    way_rad: float
    up: Vec3
    age_s: float
    is_cut: bool = False


def lay_flat(rotation: Singles, plant: LyingPlant) -> Singles:
    """Return `rotation` (3, 3) pressed onto the ground and drawn along the way of the wheel."""
    up = np.array(plant.up)
    way = np.array([math.cos(plant.way_rad), math.sin(plant.way_rad), 0.0])
    way -= up * (way @ up)
    left = CUT_RATIO if plant.is_cut else CRUSHED_RATIO
    press = np.eye(3) - (1.0 - left) * np.outer(up, up) + LEAN_RATIO * np.outer(way, up)
    return np.asarray(press @ rotation, np.float32)


def darken(tint: Singles, age_s: float) -> Singles:
    """Return the tint (3,) of a plant that fell `age_s` ago."""
    share = min(1.0, age_s / WILTING_S)
    return np.asarray(
        tint * (np.array(BRUISED) * (1.0 - share) + np.array(WILTED) * share), np.float32
    )
