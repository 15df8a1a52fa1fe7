"""How far the leaves of a plant reach, without its mesh.

A crown is half an ellipsoid over the stem, as high as the plant; its leaf area is spread evenly
over the radius, which is how it lies in the meshes of all species.
"""

from __future__ import annotations

import numpy as np

from agribot.core.messages import FloatArray
from agribot.sim.flora.habit import GOLDEN_ANGLE_RAD
from agribot.sim.flora.species import find_nearest_stage, find_species

LEAVES = 48  # equal shares of the leaf area, each at a point
HEART_M = 0.02  # radius of the place from which a young crop plant grows
# Radius over height in the growth stages of a species; a test compares them with the meshes.
RADIUS_RATIO: dict[str, tuple[float, ...]] = {
    "sugar_beet": (1.48, 1.39, 1.42), "maize": (0.82, 0.71, 0.61), "lettuce": (1.29, 1.24, 1.25),
    "grass": (0.85, 0.68, 0.71), "goosefoot": (0.84, 0.59, 0.43), "thistle": (1.30, 1.24, 1.20),
    "amaranth": (0.97, 0.75, 0.54), "carrot": (2.06, 1.46, 1.07, 0.81), "onion": (0.36, 0.34, 0.33),
    "chickweed": (3.30, 1.36, 1.64), "plantain": (1.85, 1.76, 1.58),
    "charlock": (1.34, 1.03, 0.78), "chamomile": (2.36, 1.54, 1.37, 1.35),
    "parsley": (1.84, 1.47, 1.16), "millet": (1.49, 1.11, 0.98),
    "knotweed": (3.96, 2.04, 1.34, 1.07),
    "quickweed": (1.31, 1.11, 0.84), "milk_thistle": (1.70, 1.83, 1.65),
    "mayweed": (1.74, 1.56, 1.55),
    "fodder_beet": (1.24, 1.16, 1.06),
}  # fmt: skip


def find_crown_radius_m(species: str, size_m: float) -> float:
    """Return the radius of the leaves of a plant of this height.

    Raises: DescriptionError: the species is unknown.
    """
    stage = find_species(species).stages.index(find_nearest_stage(species, size_m))
    return RADIUS_RATIO[species][stage] * size_m


def make_leaf_places() -> FloatArray:
    """Make the places of the shares of leaf area, (LEAVES, 3): x, y in radii, z in heights."""
    radius = (np.arange(LEAVES) + 0.5) / LEAVES
    angle_rad = GOLDEN_ANGLE_RAD * np.arange(LEAVES)
    height = np.sqrt(1.0 - radius**2)
    return np.column_stack([radius * np.cos(angle_rad), radius * np.sin(angle_rad), height])
