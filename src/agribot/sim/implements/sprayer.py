"""The spot sprayer in the simulator: what is below an open nozzle gets wet.

A weed is treated when the spray falls on its middle, a crop is hit when it falls on its heart, a
disc of `HEART_M` about its stem. Leaves of crop that get wet are counted on their own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agribot.core.implement.kind import Pull
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import FloatArray, ImplementCommand, PlantClass
from agribot.core.world import Plant, WorldSpec
from agribot.sim.flora.crown import HEART_M, LEAVES, find_crown_radius_m, make_leaf_places
from agribot.sim.footprints import list_places_m
from agribot.sim.implements.nearness import SectionNearness
from agribot.sim.implements.sections import DelayedSections, SectionSwath

# A flat-fan nozzle wets a thin line across the direction of travel.
SPRAY_FAN_LENGTH_M = 0.04


class SprayEffect:
    """Valves that open and close a latency after the command."""

    def __init__(self, spec: SprayerSpec, world: WorldSpec, base_height_m: float) -> None:
        self.worked_m2 = 0.0
        self._valves = DelayedSections(spec)
        is_crop = np.array([p.plant == PlantClass.CROP for p in world.plants], dtype=bool)
        hearts_m = np.where(is_crop, HEART_M, 0.0)
        places_m = list_places_m(world.plants)
        self._swath = SectionSwath(spec, places_m, hearts_m, SPRAY_FAN_LENGTH_M, base_height_m)
        self._nearness = SectionNearness(spec, world, base_height_m)
        self._crops = np.flatnonzero(is_crop)
        leaves_m = _grow_leaves([world.plants[i] for i in self._crops.tolist()])
        self._leaves = SectionSwath(
            spec, leaves_m, np.zeros(len(leaves_m)), SPRAY_FAN_LENGTH_M, base_height_m
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


def _grow_leaves(crops: Sequence[Plant]) -> FloatArray:
    """Place the shares of leaf area of all crops, `LEAVES` for each in their order, (N, 2)."""
    radius_m = np.array([find_crown_radius_m(p.species, p.size_m) for p in crops], dtype=float)
    shares = make_leaf_places()[:, :2]
    leaves_m: FloatArray = shares * radius_m[:, None, None] + list_places_m(crops)[:, None]
    return leaves_m.reshape(-1, 2)
