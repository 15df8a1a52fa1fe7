"""The first row of a field: the one on whose line the robot looks, or the one with most crop.

Where the robot looks along a row, pictures show its direction: only a metre of it is in view, and
the places of its leaves give the direction of a wide row with an error of 40 degrees. From the
side, crop votes for lines of every direction and offset, as in a Hough transform (Duda and Hart
1972).
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator

import numpy as np

from agribot.autonomy.plan.explore.crop_view import place_line
from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray, RowLine
from agribot.core.pose import Pose2

CELL_M = 0.05
# Pictures that must show crop in a cell: a single one may mistake a weed for crop.
LOOKS = 2
STEP_RAD, HALF_LINE_M = math.radians(1.5), 0.1
# Part of a line that must be in view, m, without a hole of HOLE_M: plants of one row stand nearer
# to each other, ends of neighbouring rows farther apart.
SPAN_M, HOLE_M = 0.9, 0.4
# Number of successive pictures that must agree on a line ahead, each this sure of its direction,
# with crop near the line.
LINES, AGREED_RAD, SURE_RAD = 5, math.radians(3.0), math.radians(4.0)
AHEAD_SPAN_M, AHEAD_HALF_M = 0.4, 0.2


class FirstRow:
    """Call `look` and `look_along` with every picture, then `find`."""

    def __init__(self) -> None:
        self._looks: Counter[tuple[int, int]] = Counter()
        self._lines: deque[tuple[Pose2, float] | None] = deque(maxlen=LINES)

    def look(self, crop_map_m: FloatArray) -> None:
        """Take in cells with crop, (N, 2)."""
        cells = np.unique(np.floor(crop_map_m / CELL_M).astype(np.int64), axis=0)
        self._looks.update(map(tuple, cells.tolist()))

    def look_along(self, line: RowLine | None, pose: Pose2) -> None:
        """Take in the line that a picture shows, seen from a pose; None where it shows none."""
        there = None if line is None else place_line(line, pose)
        std_rad = math.inf if line is None or line.heading_std_rad is None else line.heading_std_rad
        self._lines.append(None if there is None else (there, std_rad))

    @property
    def places(self) -> FloatArray:
        """Certain places of crop, (N, 2)."""
        kept = [cell for cell, looks in self._looks.items() if looks >= LOOKS]
        places: FloatArray = (np.array(kept, dtype=np.float64).reshape(-1, 2) + 0.5) * CELL_M
        return places

    def find(self) -> Pose2 | None:
        """Give the first crop of the row and its direction; None while too little is seen."""
        places = self.places
        if any(self._lines):
            return self._find_ahead(places)
        if len(places) * CELL_M < SPAN_M:
            return None
        for _, line in sorted(_vote(places), key=lambda vote: -vote[0]):
            row = _fit(line, places)
            if row is not None:
                return row
        return None

    def _find_ahead(self, places: FloatArray) -> Pose2 | None:
        seen = [line for line in self._lines if line is not None]
        if len(seen) < LINES or max(std_rad for _, std_rad in seen) > SURE_RAD:
            return None
        newest, _ = seen[-1]
        turns_rad = [wrap_rad(line.yaw_rad - newest.yaw_rad) for line, _ in seen]
        if np.std(turns_rad) > AGREED_RAD:
            return None
        lefts_m = [newest.locate(*line.xy_m)[1] for line, _ in seen]
        at = newest.transform(0.0, float(np.mean(lefts_m)))
        line = Pose2(*at, newest.yaw_rad + float(np.mean(turns_rad)))
        along_m, left_m = line.locate(places[:, 0], places[:, 1])
        along_m = along_m[np.abs(left_m) <= AHEAD_HALF_M]
        if not len(along_m) or np.ptp(along_m) < AHEAD_SPAN_M:
            return None
        return Pose2(*line.transform(float(along_m.min()), 0.0), line.yaw_rad)


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
