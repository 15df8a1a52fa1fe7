"""Ground where looks suspect weeds, known to be plants of the map or not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agribot.autonomy.weeds.ground_ring import (
    SIDE_CELLS,
    GroundRing,
    spread_steps,
    wrap,
)
from agribot.autonomy.weeds.poses import PoseAt
from agribot.core.implement.plants import GroundBox
from agribot.core.messages import FloatArray, WeedScores
from agribot.core.pose import Pose2

LEAST_LOOKS = 3
CERTAIN = 255.0


class WeedGround:
    """Call `add` for the scores of every frame with the pose of its capture.

    A stem under leaves shows in single looks only, and a leaf that looks like one in others: the
    mean of all looks is a better measure than the surest.
    """

    def __init__(self) -> None:
        self._ring = GroundRing()
        self._mean = np.zeros((SIDE_CELLS, SIDE_CELLS), dtype=np.float32)
        self._looks = np.zeros((SIDE_CELLS, SIDE_CELLS), dtype=np.int32)

    def shift(self, shift: Pose2) -> None:
        """Move all cells by a correction of the pose that they were seen from."""
        self._ring.shift(shift)

    def add(self, scores: WeedScores, pose: PoseAt) -> None:
        """Take in what one frame shows; cells that it does not show keep what is known of them."""
        seen = np.frombuffer(scores.scores, dtype=np.uint8).reshape(scores.rows, scores.columns)
        i, j, row, column = self._ring.find_covered(scores, pose.map_from_body, seen > 0)
        at, is_held = wrap(i, j), self._ring.find_held(i, j)
        looks = np.where(is_held, self._looks[at], 0) + 1
        before = np.where(is_held, self._mean[at], 0.0)
        self._mean[at] = before + (seen[row, column] / CERTAIN - before) / looks
        self._looks[at] = looks
        self._ring.take(i, j)

    def find_scores(self, box: GroundBox, left_m: Sequence[float]) -> FloatArray:
        """Find how surely a stem of a weed stands in boxes `left_m` to the left of one, (N,).

        What was not looked at three times scores 0.
        """
        along_m = spread_steps(box.half_x_m)[None, :, None]
        across_m = np.array(left_m)[:, None, None] + spread_steps(box.half_y_m)[None, None, :]
        i, j = self._ring.find_cells(box.middle, along_m, across_m)
        is_seen = self._ring.find_held(i, j) & (self._looks[wrap(i, j)] >= LEAST_LOOKS)
        scores: FloatArray = np.where(is_seen, self._mean[wrap(i, j)], 0.0).max(axis=(1, 2))
        return scores
