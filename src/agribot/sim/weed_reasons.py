"""Why each weed that truly stands in the field was not treated."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.implement.left_weeds import PASSED, Passage
from agribot.core.messages import FloatArray, MappedPlant, PlantClass
from agribot.core.world import Plant
from agribot.sim.plant_judge import MATCH_RADIUS_M, find_pairs

NOT_HIT = "aimed at and not hit"
NEVER_SEEN = "never seen enough"
CALLED_CROP = "called crop"
MERGED = "merged with a neighbour"
MISPLACED = "misplaced on the map"
NOT_MAPPED = "seen and not mapped"

LEAST_LOOKS = 2
# Distance to another weed of the map that took the sightings of this one: the usual
# `weeds.merge_radius_m`.
MERGED_M = 0.12
MISPLACED_M = 0.25  # distance to a weed of the map where none stands


class PlantsOnMap(NamedTuple):
    """Weeds and crops of the robot's map."""

    weeds: Sequence[MappedPlant]
    crops: Sequence[MappedPlant]


class UntreatedWeeds:
    """Finds the reason of a true weed from what the map has where it stands."""

    def __init__(
        self,
        plants: Sequence[Plant],
        on_map: PlantsOnMap,
        passage: Passage,
        looks: Mapping[int, int],
    ) -> None:
        """Compare the world with a map; `looks` are pictures that showed a plant, by its index."""
        self._plants, self._passage, self._looks = plants, passage, looks
        weeds_m, crops_m = (_xy_m(group) for group in on_map)
        true = {
            kind: [index for index, plant in enumerate(plants) if plant.plant == kind]
            for kind in (PlantClass.WEED, PlantClass.CROP)
        }
        pairs = self._pair(weeds_m, true[PlantClass.WEED])
        self._own: dict[int, MappedPlant] = {
            true[PlantClass.WEED][j]: on_map.weeds[i] for i, j in pairs.tolist()
        }
        self._taken_m = weeds_m[pairs[:, 0]]
        self._spare_m = np.delete(weeds_m, pairs[:, 0], axis=0)
        crops = self._pair(crops_m, true[PlantClass.CROP])
        self._spare_crops_m = np.delete(crops_m, crops[:, 0], axis=0)

    def list_reasons(self, left: Collection[int]) -> list[str]:
        """List the reasons of untreated weeds, by their indices."""
        return [self.find_reason(index) for index in left]

    def find_reason(self, index: int) -> str:
        """Find why a weed of the world was not treated."""
        plant, own = self._plants[index], self._own.get(index)
        if own is not None and own.treated_s is not None:
            return NOT_HIT
        if own is not None and own.left:
            return own.left
        where = self._passage.explain(plant.x_map_m, plant.y_map_m)
        return where if own is not None or where != PASSED else self._explain_unmapped(index)

    def _explain_unmapped(self, index: int) -> str:
        at_m = self._plants[index].x_map_m, self._plants[index].y_map_m
        if _has_near(self._spare_crops_m, at_m, MATCH_RADIUS_M):
            return CALLED_CROP
        if self._looks.get(index, 0) < LEAST_LOOKS:
            return NEVER_SEEN
        if _has_near(self._taken_m, at_m, MERGED_M):
            return MERGED
        return MISPLACED if _has_near(self._spare_m, at_m, MISPLACED_M) else NOT_MAPPED

    def _pair(self, mapped_m: FloatArray, true: Sequence[int]) -> npt.NDArray[np.intp]:
        true_m = _xy_m(self._plants[index] for index in true)
        return find_pairs(mapped_m, true_m, MATCH_RADIUS_M)


def _xy_m(plants: Iterable[Plant] | Iterable[MappedPlant]) -> FloatArray:
    return np.array([(plant.x_map_m, plant.y_map_m) for plant in plants]).reshape(-1, 2)


def _has_near(places_m: FloatArray, at_m: tuple[float, float], radius_m: float) -> bool:
    return bool((np.hypot(*(places_m - at_m).T) <= radius_m).any())
