"""Which waypoints the robot has reached."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.core.errors import MissionError
from agribot.core.facts import WaypointPassed
from agribot.core.messages import Path


class Visits:
    """Waypoints in the order of the path; each counts only while the path passes it."""

    def __init__(
        self, path: Path, waypoints: Sequence[tuple[float, float]], radius_m: float
    ) -> None:
        self._points = tuple(waypoints)
        self._radius_m = radius_m
        self._s_m = _find_places(path, self._points, radius_m)
        self._next = 0
        self.reached: tuple[bool, ...] = (False,) * len(self._points)

    def restore(self, reached: Sequence[bool]) -> None:
        """Take over what was reached before; the search goes on behind it."""
        self.reached = tuple(reached)
        self._next = next((k for k, hit in enumerate(self.reached) if not hit), len(self.reached))

    def update(self, s_m: float, x_map_m: float, y_map_m: float) -> None:
        while self._next < len(self._points) and s_m >= self._s_m[self._next] - self._radius_m:
            goal_x_m, goal_y_m = self._points[self._next]
            if math.hypot(goal_x_m - x_map_m, goal_y_m - y_map_m) <= self._radius_m:
                self.reached = (
                    *self.reached[: self._next], True, *self.reached[self._next + 1 :],
                )  # fmt: skip
            elif s_m <= self._s_m[self._next] + self._radius_m:
                return
            self._next += 1

    @property
    def next_point(self) -> tuple[float, float] | None:
        """The next waypoint; None after the last and without waypoints."""
        return self._points[self._next] if self._next < len(self._points) else None

    def list_missed(self) -> list[int]:
        """List the waypoints that were not reached, counted from 1."""
        return [number for number, is_reached in enumerate(self.reached, 1) if not is_reached]


def _find_places(
    path: Path, points: Sequence[tuple[float, float]], radius_m: float
) -> tuple[float, ...]:
    """Distance along the path where it first passes each waypoint, in order."""
    places, first = [], 0
    for number, point in enumerate(points):
        away_m = np.hypot(*(path.xy_map_m[first:] - np.array(point)).T)
        inside = away_m <= radius_m
        if not inside.any():
            raise MissionError(WaypointPassed(number + 1, float(away_m.min()), radius_m))
        enter = int(np.argmax(inside))
        stay = int(np.argmin(inside[enter:])) or len(inside) - enter
        first += enter + int(np.argmin(away_m[enter : enter + stay]))
        places.append(float(path.s_m[first]))
    return tuple(places)
