"""The weeds that truly stand along the rows, those treated, and the reasons of the others."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from agribot.core.implement.left_weeds import Passage, count_reasons
from agribot.core.implement.row_shares import TreatedShare, share_by_rows
from agribot.core.messages import PlantClass, Row
from agribot.core.world import Plant
from agribot.sim.plant_judge import is_in_strips
from agribot.sim.weed_reasons import PlantsOnMap, UntreatedWeeds


class TrueWeeds:
    """Weeds of a world in strips of width `pitch_m` along its rows; `treated` are indices."""

    def __init__(
        self,
        plants: Sequence[Plant],
        rows: Sequence[Row],
        pitch_m: float,
        treated: Collection[int],
    ) -> None:
        self._plants, self._rows, self._pitch_m, self._treated = plants, rows, pitch_m, treated

    def share_by_rows(self, strips: Sequence[Row]) -> tuple[TreatedShare, TreatedShare]:
        """Count the weeds along some of the rows: those in a row, and those between the rows."""
        places = [
            (self._plants[index].x_map_m, self._plants[index].y_map_m, index in self._treated)
            for index in self._list_along(strips)
        ]
        return share_by_rows(places, self._rows)

    def count_untreated(
        self, on_map: PlantsOnMap, passage: Passage, looks: Mapping[int, int]
    ) -> dict[str, int]:
        """Count the weeds along all rows that were not treated, by the reason why."""
        left = [index for index in self._list_along(self._rows) if index not in self._treated]
        reasons = UntreatedWeeds(self._plants, on_map, passage, looks)
        return count_reasons(reasons.list_reasons(left))

    def _list_along(self, strips: Sequence[Row]) -> list[int]:
        return [
            index
            for index, plant in enumerate(self._plants)
            if plant.plant == PlantClass.WEED
            and is_in_strips(plant.x_map_m, plant.y_map_m, strips, self._pitch_m)
        ]
