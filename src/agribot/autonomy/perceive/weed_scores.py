"""What a plant network says about stems of weeds, as cells of the ground."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.crop_cover import CELL_M
from agribot.autonomy.perceive.stems import CELL_PX, PlantMaps, pool_squares
from agribot.core.messages import PlantClass, WeedScores

# Distance from the camera within which a stem is separate from its neighbours and leaves hide less.
NEAR_M = 0.9


class ScoreGrid:
    """Cell of the ground of each cell of one camera's maps; built once."""

    def __init__(
        self,
        x_body_m: npt.NDArray[np.float32],
        y_body_m: npt.NDArray[np.float32],
        range_m: npt.NDArray[np.float32],
    ) -> None:
        """All (h, w): the ground of each pixel, and how far off the camera it is."""
        middle = slice(CELL_PX // 2, None, CELL_PX)
        self._is_near = range_m[middle, middle] <= NEAR_M
        ground_m = np.stack([x_body_m, y_body_m])[:, middle, middle][:, self._is_near]
        cell = np.floor(ground_m / CELL_M).astype(np.int64)
        # A camera that looks far ahead only sees no such ground.
        first = cell.min(axis=1) if cell.size else np.zeros(2, dtype=np.int64)
        row, column = cell - first[:, None]
        self._rows, self._columns = int(row.max(initial=0)) + 1, int(column.max(initial=0)) + 1
        self._cell = row * self._columns + column
        self._corner_m = (float(first[0]) * CELL_M, float(first[1]) * CELL_M)

    def score(self, maps: PlantMaps) -> WeedScores:
        """Score each cell by the surest stem of a weed that the network sees in it."""
        scores = np.zeros(self._rows * self._columns, dtype=np.uint8)
        seen = pool_squares(maps.stem_score[PlantClass.WEED])[self._is_near]
        np.maximum.at(scores, self._cell, np.maximum(seen, 1))
        return WeedScores(
            x_body_m=self._corner_m[0],
            y_body_m=self._corner_m[1],
            cell_m=CELL_M,
            rows=self._rows,
            columns=self._columns,
            scores=scores.tobytes(),
        )
