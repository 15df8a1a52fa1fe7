"""The first row of a field: the line on which most crop stands of all that was seen so far.

Crop votes for lines of every direction and offset, as in a Hough transform (Duda and Hart 1972).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.pose import Pose2

CELL_M = 0.05
# A cell counts that showed crop in so many pictures: a weed is taken for crop in single ones.
LOOKS = 2
STEP_RAD, HALF_LINE_M = math.radians(1.5), 0.1
# So much of a line must be in view without a hole: plants of one row stand nearer to each other,
# ends of neighbouring rows farther apart.
SPAN_M, HOLE_M = 0.9, 0.4


class FirstRow:
    """Call `look` with the crop of every picture, then `find`."""

    def __init__(self) -> None:
        self._looks: Counter[tuple[int, int]] = Counter()

    def look(self, crop_map_m: FloatArray) -> None:
        """Take in cells with crop, (N, 2)."""
        cells = np.unique(np.floor(crop_map_m / CELL_M).astype(np.int64), axis=0)
        self._looks.update(map(tuple, cells.tolist()))

    @property
    def places(self) -> FloatArray:
        """Where crop stands for sure, (N, 2)."""
        kept = [cell for cell, looks in self._looks.items() if looks >= LOOKS]
        places: FloatArray = (np.array(kept, dtype=np.float64).reshape(-1, 2) + 0.5) * CELL_M
        return places

    def find(self) -> Pose2 | None:
        """Give the first crop of the row and its direction; None while too little is seen."""
        places = self.places
        if len(places) * CELL_M < SPAN_M:
            return None
        for _, line in sorted(_vote(places), key=lambda vote: -vote[0]):
            row = _fit(line, places)
            if row is not None:
                return row
        return None


def _vote(places: FloatArray) -> Iterator[tuple[int, Pose2]]:
    """Find the line through the most places of each direction, and how many these are."""
    middle_x_m, middle_y_m = places.mean(axis=0).tolist()
    for yaw_rad in np.arange(0.0, math.pi, STEP_RAD).tolist():
        frame = Pose2(middle_x_m, middle_y_m, yaw_rad)
        _, left_m = frame.locate(places[:, 0], places[:, 1])
        bins = np.floor((left_m - left_m.min()) / CELL_M).astype(np.int64)
        votes = np.convolve(np.bincount(bins), np.ones(round(2.0 * HALF_LINE_M / CELL_M)))
        most = int(np.argmax(votes))
        aside_m = float(left_m.min()) + (most + 1) * CELL_M - HALF_LINE_M
        yield int(votes[most]), Pose2(*frame.transform(0.0, aside_m), yaw_rad)


def _fit(line: Pose2, places: FloatArray) -> Pose2 | None:
    """Fit the longest piece of a line that has crop without a hole; None where it is too short."""
    along_m, left_m = line.locate(places[:, 0], places[:, 1])
    near = np.abs(left_m) <= HALF_LINE_M
    order = np.argsort(along_m[near])
    along_m, left_m = along_m[near][order], left_m[near][order]
    runs = np.split(np.arange(len(along_m)), np.flatnonzero(np.diff(along_m) > HOLE_M) + 1)
    run = max(runs, key=lambda each: float(np.ptp(along_m[each])) if len(each) else 0.0)
    if not len(run) or float(np.ptp(along_m[run])) < SPAN_M:
        return None
    slope, off_m = np.polyfit(along_m[run], left_m[run], 1)
    first_m = float(along_m[run].min())
    at = line.transform(first_m, float(off_m + slope * first_m))
    return Pose2(*at, line.yaw_rad + math.atan(float(slope)))
