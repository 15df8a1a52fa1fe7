"""How near the middles of working sections come to the weeds of a world."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.core.implement.spec import ImplementSpec
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.world import WorldSpec
from agribot.sim.footprints import Footprints, list_places_m, project_to_ground

NEAR_M = 0.1  # distance within which the section works for this weed


class SectionNearness:
    """Keeps the least distance of each weed from the ways of the sections' middles."""

    def __init__(self, spec: ImplementSpec, world: WorldSpec, base_height_m: float) -> None:
        self._index = [i for i, p in enumerate(world.plants) if p.plant == PlantClass.WEED]
        self._xy_m = list_places_m([world.plants[i] for i in self._index])
        self._least_m = np.full(len(self._xy_m), np.inf)
        self._feet = Footprints(
            np.array([(spec.x_body_m, y_m) for y_m in spec.section_y_body_m()]),
            0.0,
            0.0,
            base_height_m,
        )

    def measure(self, before: FloatArray, after: FloatArray, is_on: npt.NDArray[np.bool_]) -> None:
        """Look at the ways of the working sections between two rows of the physics history."""
        for x_body_m, y_body_m in self._feet.xy_body_m[is_on].tolist():
            start_m = np.array(project_to_ground(before, x_body_m, y_body_m, self._feet))
            end_m = np.array(project_to_ground(after, x_body_m, y_body_m, self._feet))
            near = np.flatnonzero(np.abs(self._xy_m - end_m).max(axis=1, initial=0.0) < 2 * NEAR_M)
            if len(near):
                gap_m = _measure_gaps(self._xy_m[near], start_m, end_m)
                self._least_m[near] = np.minimum(self._least_m[near], gap_m)

    @property
    def least_m(self) -> dict[int, float]:
        """Index into the world's plants -> distance, of the weeds nearer than `NEAR_M`."""
        near = np.flatnonzero(self._least_m < NEAR_M)
        return {self._index[i]: float(self._least_m[i]) for i in near.tolist()}


def _measure_gaps(xy_m: FloatArray, start_m: FloatArray, end_m: FloatArray) -> FloatArray:
    """Measure the distances of places (N, 2) from the line between two points."""
    way_m, to_m = end_m - start_m, xy_m - start_m
    length2_m2 = float(way_m @ way_m)
    along = np.clip(to_m @ way_m / length2_m2, 0.0, 1.0) if length2_m2 else np.zeros(len(xy_m))
    gap_m: FloatArray = np.hypot(*(to_m - along[:, None] * way_m).T)
    return gap_m
