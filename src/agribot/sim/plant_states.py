"""What has become of the plants of a world since the run began."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray
from agribot.sim.underside import Part


class PlantStates:
    """One state for each plant, by its index in the world; times are NaN until it happens.

    `crushed_s`: it lies flat and is dead. `brushed_s`: its leaves were touched and it lives.
    `cut_s`: a tool took it out of the ground and it lies there. `sprayed_s`: it is wet and dies
    in days. `crushed_by` holds a `Part` or 0, `way_rad` where the robot went as it fell.
    """

    def __init__(self, count: int) -> None:
        self.crushed_s: FloatArray = np.full(count, np.nan)
        self.brushed_s: FloatArray = np.full(count, np.nan)
        self.cut_s: FloatArray = np.full(count, np.nan)
        self.sprayed_s: FloatArray = np.full(count, np.nan)
        self.crushed_by: npt.NDArray[np.uint8] = np.zeros(count, np.uint8)
        self.way_rad: FloatArray = np.zeros(count)
        self.is_standing: npt.NDArray[np.bool_] = np.ones(count, dtype=bool)
        self._fallen: list[int] = []
        self._sprayed: list[int] = []

    @property
    def sprayed(self) -> tuple[int, ...]:
        """Wet plants, in the order in which they were sprayed."""
        return tuple(self._sprayed)

    @property
    def fallen(self) -> tuple[int, ...]:
        """Plants that lie, crushed or cut, in the order in which they fell."""
        return tuple(self._fallen)

    def crush(self, index: int, t_s: float, by: Part, way_rad: float) -> None:
        """Lay a plant flat; one that lies already is not crushed again."""
        if self.is_standing[index]:
            self.crushed_s[index], self.crushed_by[index] = t_s, by
            self._fell(index, way_rad)

    def cut(self, index: int, t_s: float, way_rad: float) -> None:
        """Take a plant out of the ground; the one that lay there already is no other for it."""
        if np.isnan(self.cut_s[index]):
            self.cut_s[index] = t_s
            if self.is_standing[index]:
                self._fell(index, way_rad)

    def spray(self, index: int, t_s: float) -> None:
        if np.isnan(self.sprayed_s[index]):
            self.sprayed_s[index] = t_s
            self._sprayed.append(index)

    def find_fall_s(self, index: int) -> float:
        """Return when a plant fell, NaN while it stands."""
        return float(np.fmin(self.crushed_s[index], self.cut_s[index]))

    def _fell(self, index: int, way_rad: float) -> None:
        self.is_standing[index], self.way_rad[index] = False, way_rad
        self._fallen.append(index)
