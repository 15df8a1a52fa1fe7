"""How far along its path the robot has come."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

import numpy as np

from agribot.autonomy.plan.ways.speed import find_pivots
from agribot.core.arithmetic import view_floats
from agribot.core.geo import is_backwards
from agribot.core.messages import Path

_AHEAD = 50  # points, about 1 m: farther than any tick leads, nearer than any other row
_BACK_M = 3.0
PIVOT_REACH_M = 0.02


class PathProgress:
    """Monotone distance along a path, found by a local search.

    Only neighbouring points are compared, so a neighbouring row or a crossing of the path with
    itself never captures it.
    """

    def __init__(self, path: Path) -> None:
        self._x = view_floats(path.xy_map_m[:, 0])
        self._y = view_floats(path.xy_map_m[:, 1])
        course_rad = path.yaw_map_rad + np.pi * is_backwards(path.xy_map_m, path.yaw_map_rad)
        self._cos = view_floats(np.fromiter(map(math.cos, course_rad), float, len(course_rad)))
        self._sin = view_floats(np.fromiter(map(math.sin, course_rad), float, len(course_rad)))
        self._s = view_floats(path.s_m)
        self.length_m = self._s[-1]
        self._pivots = find_pivots(path)
        self.index = 0
        self.s_m = 0.0
        self.cross_track_m = 0.0
        self.off_path_m = 0.0

    def jump(self, s_m: float) -> None:
        """Go on from a distance that was reached before."""
        self.s_m = min(max(s_m, 0.0), self.length_m)
        self.index = max(bisect_right(self._s, self.s_m) - 1, 0)

    def advance(self, x_map_m: float, y_map_m: float) -> None:
        """Follow the robot forwards; `cross_track_m` is positive to the left of the way."""
        index, best = self.index, self._square_m2(self.index, x_map_m, y_map_m)
        for ahead in range(index + 1, min(index + _AHEAD, len(self._x))):
            square = self._square_m2(ahead, x_map_m, y_map_m)
            if square > best:
                break
            index, best = ahead, square
        index = self._past_pivot(index)
        dx, dy = x_map_m - self._x[index], y_map_m - self._y[index]
        along_m = self._cos[index] * dx + self._sin[index] * dy
        spacing_m = self._s[min(index + 1, len(self._s) - 1)] - self._s[index]
        self.index = index
        self.s_m = max(self.s_m, self._s[index] + min(max(along_m, 0.0), spacing_m))
        self.cross_track_m = self._cos[index] * dy - self._sin[index] * dx
        self.off_path_m = math.sqrt(best)

    def _past_pivot(self, index: int) -> int:
        """Return the next point at a turn in place that is all but reached, else the same."""
        coming = bisect_left(self._pivots, index)
        if coming < len(self._pivots):
            pivot = self._pivots[coming]
            if self._s[pivot] - self._s[index] <= PIVOT_REACH_M:
                return pivot + 1
        return index

    def off_driven_path_m(self, x_map_m: float, y_map_m: float) -> float:
        """Measure the distance to the last 3 m of path: who was pushed back is not off its path."""
        index, best = self.index, math.inf
        while index >= 0 and self.s_m - self._s[index] < _BACK_M:
            best = min(best, self._square_m2(index, x_map_m, y_map_m))
            index -= 1
        return math.sqrt(best)

    def _square_m2(self, index: int, x_map_m: float, y_map_m: float) -> float:
        dx, dy = x_map_m - self._x[index], y_map_m - self._y[index]
        return dx * dx + dy * dy
