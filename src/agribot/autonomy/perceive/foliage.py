"""How foliage above the ground looks farther away and bigger than it is."""

from __future__ import annotations

import math

from agribot.core.messages import PlantClass

# Mean height of the foliage over the diameter of the plant, fitted to 647 plants of seven
# simulated species seen from 0.6 and 0.9 m: 0.35 (thistle) to 0.65 (amaranth) for weeds, 0.25
# (lettuce) and 0.3 (sugar beet) for crops, but 0.8 for maize, which is all height.
HEIGHT_RATIO = {PlantClass.WEED: 0.55, PlantClass.CROP: 0.32}


def find_height_m(plant: PlantClass, area_m2: float) -> float:
    """Find how high the leaves of a plant that covers `area_m2` stand on average."""
    return HEIGHT_RATIO[plant] * 2.0 * math.sqrt(area_m2 / math.pi)


def find_nearer_ratio(plant: PlantClass, area_m2: float, camera_height_m: float) -> float:
    """Find by which ratio foliage that covers `area_m2` of the ground in the picture is nearer.

    Foliage at a height h, seen from a height H, seems to lie H / (H - h) times as far away and
    to be as much wider. The mean h of a plant is taken in proportion to its diameter.
    """
    return 1.0 / (1.0 + find_height_m(plant, area_m2) / camera_height_m)
