"""The spot sprayer in the simulator: what is below an open nozzle gets wet.

A weed is treated when the spray falls on its middle, a crop is hit when it falls on its heart, a
disc of `HEART_M` about its stem. Leaves of crop that get wet are counted on their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.implement.kind import Pull
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import FloatArray, ImplementCommand, PlantClass
from agribot.core.world import WorldSpec
from agribot.sim.flora.crown import LEAVES, find_crown_radius_m, make_leaf_places
from agribot.sim.implements.nearness import SectionNearness
from agribot.sim.implements.sections import DelayedSections, SectionSwath

# A flat-fan nozzle wets a thin line across the direction of travel.
SPRAY_FAN_LENGTH_M = 0.04
HEART_M = 0.02  # from where a young crop plant grows


class _LeafPlace(NamedTuple):
    """An equal share of the leaf area of a plant."""

    x_map_m: float
    y_map_m: float


class SprayEffect:
    """Valves that open and close a latency after the command."""

    def __init__(self, spec: SprayerSpec, world: WorldSpec, base_height_m: float) -> None:
        self.worked_m2 = 0.0
        self._valves = DelayedSections(spec)
        is_crop = np.array([p.plant == PlantClass.CROP for p in world.plants], dtype=bool)
        hearts_m = np.where(is_crop, HEART_M, 0.0)
        self._swath = SectionSwath(spec, world.plants, hearts_m, SPRAY_FAN_LENGTH_M, base_height_m)
        self._nearness = SectionNearness(spec, world, base_height_m)
        self._crops = np.flatnonzero(is_crop)
        places = _grow_leaves(world, self._crops)
        self._leaves = SectionSwath(
            spec, places, np.zeros(len(places)), SPRAY_FAN_LENGTH_M, base_height_m
        )

    def command(self, t_s: float, command: ImplementCommand) -> None:
        self._valves.command(t_s, command.sections_on)

    def update(self, t_s: float, before: FloatArray, after: FloatArray, dt_s: float) -> None:
        """Spray over the tick that ends at `t_s`; valves move at its start."""
        self._valves.advance(t_s - dt_s)
        if self._valves.is_on.any():
            self.worked_m2 += self._swath.sweep(t_s, before, after, self._valves.is_on)
            self._leaves.sweep(t_s, before, after, self._valves.is_on)
            self._nearness.measure(before, after, self._valves.is_on)

    def pull(self) -> Pull | None:
        return None

    @property
    def treated(self) -> dict[int, float]:
        return self._swath.touched

    @property
    def offsets_m(self) -> dict[int, float]:
        """Index of a weed -> how near the middle of an open nozzle came to it, below 10 cm."""
        return self._nearness.least_m

    @property
    def wet_leaves(self) -> dict[int, float]:
        """Index of a crop plant in the world -> share of its leaf area that got wet, above 0."""
        wet = np.array(list(self._leaves.touched), dtype=np.int64) // LEAVES
        counts = np.bincount(wet, minlength=len(self._crops))
        wet_by_crop = zip(self._crops.tolist(), counts.tolist(), strict=True)
        return {index: count / LEAVES for index, count in wet_by_crop if count}


def _grow_leaves(world: WorldSpec, crops: npt.NDArray[np.int64]) -> list[_LeafPlace]:
    """Place the shares of leaf area of all crops, `LEAVES` for each, in their order."""
    shares = make_leaf_places()[:, :2]
    places = []
    for index in crops.tolist():
        plant = world.plants[index]
        radius_m = find_crown_radius_m(plant.species, plant.size_m)
        at_m = shares * radius_m + (plant.x_map_m, plant.y_map_m)
        places += [_LeafPlace(x_m, y_m) for x_m, y_m in at_m.tolist()]
    return places
