"""Noticing that a mission makes no headway, whatever holds the robot."""

from __future__ import annotations

import math

HEADWAY_M = 0.05


class StallWatch:
    """Call it while the mission runs; `restart` when it starts or goes on after a pause."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._best_m = -math.inf
        self._since_s = math.nan

    def restart(self) -> None:
        self._best_m, self._since_s = -math.inf, math.nan

    def is_stalled(self, s_m: float, t_s: float) -> bool:
        """Say whether `s_m` along the path has not grown by HEADWAY_M for too long."""
        if s_m >= self._best_m + HEADWAY_M:
            self._best_m, self._since_s = s_m, t_s
        return t_s - self._since_s > self._limit_s
