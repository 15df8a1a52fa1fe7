"""Ways of a receiver and of the wheels side by side: their lengths, and which way they turn."""

from __future__ import annotations

import cmath
import math
import statistics

import numpy as np

from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import GnssFix

# Ways of wheels and fixes are compared over this time, s, from this length on, m; their sum counts
# from the last value on, m.
WAY_S, LEAST_PIECE_M, WAY_SIGMA, LEAST_WAY_M = 5.0, 1.0, 4.0, 20.0
LEAST_TURNS = 5  # least turns from piece to piece; fewer show no agreement
LONGEST_STEP_S = 1.0  # time between two readings of the wheels; longer ones are gaps


class WheelWay:
    """Position by the wheels alone, from the start of the log."""

    def __init__(self) -> None:
        self.place_m = 0j
        self._yaw_rad = 0.0
        self._last_s = -math.inf

    def add(self, t_s: float, v_mps: float, yaw_radps: float) -> None:
        dt_s = t_s - self._last_s
        self._last_s = t_s
        if 0.0 < dt_s < LONGEST_STEP_S:
            self.place_m += cmath.rect(v_mps * dt_s, self._yaw_rad + yaw_radps * dt_s / 2.0)
            self._yaw_rad += yaw_radps * dt_s


class FixWays:
    """Ways of one receiver and of the wheels, each from where it was some seconds before."""

    def __init__(self, first: GnssFix) -> None:
        self.first = first
        datum = Datum(lat_deg=first.lat_deg, lon_deg=first.lon_deg, alt_m=first.alt_m)
        self._frame = MapFrame(datum)
        self._mark: tuple[float, complex, complex] | None = None  # time, by fixes, by wheels
        self._fixes_m = self._wheels_m = 0.0
        self._ratios: list[float] = []
        self._last: tuple[complex, complex] | None = None  # the piece before, both ways
        self._turn_count = 0
        self._turns = np.zeros(3)  # squares of turns by fixes and by wheels, and their product

    @property
    def turn_agreement(self) -> float:
        """Agreement of turns by fixes and by wheels: 1 fully, -1 they are mirrored, 0 unknown."""
        by_fixes, by_wheels, both = self._turns.tolist()
        if self._turn_count < LEAST_TURNS or by_fixes * by_wheels == 0.0:
            return 0.0
        return float(both / math.sqrt(by_fixes * by_wheels))

    @property
    def ratio(self) -> float | None:
        """Way of the wheels over that of the fixes; None of too short a way.

        The median of the pieces does not hear single fixes that lie elsewhere.
        """
        if max(self._fixes_m, self._wheels_m) < LEAST_WAY_M:
            return None
        return statistics.median(self._ratios)

    def add(self, t_s: float, fix: GnssFix, wheels_m: complex) -> None:
        if self._mark is not None and t_s - self._mark[0] < WAY_S:
            return
        east_m, north_m, _ = self._frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, fix.alt_m)
        here_m = complex(east_m, north_m)
        if self._mark is not None:
            self._count(here_m - self._mark[1], wheels_m - self._mark[2], fix)
        self._mark = t_s, here_m, wheels_m

    def _count(self, by_fixes_m: complex, by_wheels_m: complex, fix: GnssFix) -> None:
        """Count a way that is more than the scatter of the fixes."""
        fixes_m, wheels_m = abs(by_fixes_m), abs(by_wheels_m)
        if max(fixes_m, wheels_m) <= max(LEAST_PIECE_M, WAY_SIGMA * fix.pos_std_m):
            self._last = None
            return
        self._fixes_m += fixes_m
        self._wheels_m += wheels_m
        self._ratios.append(wheels_m / max(fixes_m, 1e-9))
        if self._last is not None:
            turns = [
                (now * last.conjugate()).imag / max(abs(now * last), 1e-9)
                for now, last in zip((by_fixes_m, by_wheels_m), self._last, strict=True)
            ]
            self._turn_count += 1
            self._turns += (turns[0] ** 2, turns[1] ** 2, turns[0] * turns[1])
        self._last = by_fixes_m, by_wheels_m
