"""Where a prescription lets the implement work, and with which rate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.implement.plants import CropCells, Disc, GroundBox, KnownPlant, PlantMap
from agribot.core.messages import FloatArray


class ZoneMap(NamedTuple):
    """Rates in litres per hectare on upright cells of the map, `rates` (rows, columns).

    Rows grow to the North and columns to the East from a corner. A rate of 0 is a zone that is
    spared, NaN is ground without a zone, which is spared as well.
    """

    x_min_m: float
    y_min_m: float
    cell_m: float
    rates_lpha: npt.NDArray[np.float32]

    def find_rates(self, x_map_m: FloatArray, y_map_m: FloatArray) -> FloatArray:
        """Find the rates at places (...,); NaN where there is no zone."""
        rows, columns = self.rates_lpha.shape
        column = np.floor((x_map_m - self.x_min_m) / self.cell_m).astype(np.int64)
        row = np.floor((y_map_m - self.y_min_m) / self.cell_m).astype(np.int64)
        is_inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        found = self.rates_lpha[np.where(is_inside, row, 0), np.where(is_inside, column, 0)]
        rates: FloatArray = np.where(is_inside, found, np.nan)
        return rates

    def spares(self, box: GroundBox) -> bool:
        """Whether any of a box is not worked."""
        along_m, across_m = self._steps(box.half_x_m)[:, None], self._steps(box.half_y_m)[None, :]
        rates = self.find_rates(*box.middle.transform(along_m, across_m))
        return not bool((rates > 0.0).all())

    def _steps(self, half_m: float) -> FloatArray:
        """List places across the zones, half a cell beyond both borders and at most that apart."""
        reach_m = half_m + self.cell_m / 2.0
        return np.linspace(-reach_m, reach_m, math.ceil(4.0 * reach_m / self.cell_m) + 1)


class ZonedPlants:
    """The plants around the robot as an implement may work on them: spared zones count as crop."""

    def __init__(self, plants: PlantMap, zones: ZoneMap) -> None:
        self._plants = plants
        self.crop_ground = _ZonedGround(plants.crop_ground, zones)
        self.weed_ground = plants.weed_ground

    def inside(
        self, x_min_m: float, y_min_m: float, x_max_m: float, y_max_m: float
    ) -> Iterable[KnownPlant]:
        return self._plants.inside(x_min_m, y_min_m, x_max_m, y_max_m)

    def mark_treated(self, id: int, t_s: float) -> None:
        self._plants.mark_treated(id, t_s)

    def note_left(self, id: int, reason: str) -> None:
        self._plants.note_left(id, reason)


class _ZonedGround:
    def __init__(self, ground: CropCells, zones: ZoneMap) -> None:
        self._ground, self._zones = ground, zones

    def covers(
        self, box: GroundBox, known: Sequence[Disc] = (), stems: Sequence[Disc] = ()
    ) -> bool:
        return self._zones.spares(box) or self._ground.covers(box, known, stems)

    def is_seen(self, box: GroundBox) -> bool:
        return self._ground.is_seen(box)

    def is_alone(self, plant: Disc) -> bool:
        return self._ground.is_alone(plant)
