"""How fast and how far a receiver's slow error wanders, learnt against wheels and gyro."""

from __future__ import annotations

import math
import statistics
from collections import deque
from typing import NamedTuple

import msgspec

from agribot.autonomy.estimate.sensors.gnss_noise import FixNoise
from agribot.core.arithmetic import clamp

# Time between two fixes that are compared: long against their white noise, short against what
# wheels and gyro lose of their way.
LAG_S = 3.0
# Time over which the walk is judged, and the least that says something.
MEMORY_S, LEAST_S = 120.0, 20.0
# Walk of a receiver that states no velocity and has no base near by, until it is learnt.
UNSEEN_WALK_M_PER_SQRT_S = 0.4
# Least multiple of the stated walk from which a learnt walk counts: slipping wheels look like one,
# too.
SURE_WALK_RATIO = 2.0
# Largest learnt walk, as a multiple of the stated one.
MOST_WALK_RATIO = 10.0
# Time in which reflections from walls and trees change, as seen by a robot that drives past.
REFLECTION_S = 40.0
# The median of the squared length of two normal errors, over the variance of one.
SQUARE_MEDIAN = 2.0 * math.log(2.0)


class _Seen(NamedTuple):
    t_s: float
    apart_m: complex
    way_m: float


class GnssWander:
    """Learns the slow error of a receiver without corrections.

    A stated accuracy is a claim: beside walls and trees receivers wander by metres while they
    state one. It shows in how positions move against the way of wheels and gyro within seconds,
    whatever the filter believes; the median does not hear single outliers.
    """

    def __init__(self) -> None:
        self._seen: deque[_Seen] = deque()
        self._walks: deque[tuple[float, float]] = deque()  # time, and variance per second
        self._walk_m_per_sqrt_s = math.nan
        self._least_size_m = 0.0

    def add(
        self, t_s: float, apart_m: complex, way_m: float, lost_ratio: float, white_m: float
    ) -> None:
        """Take the place of a fix less the way, east and north as one complex number.

        `way_m` is the length of the way up to it, `lost_ratio` the 1 sigma of the error of wheels
        and gyro as a share of it, and `white_m` the scatter of the fix.
        """
        self._seen.append(_Seen(t_s, apart_m, way_m))
        while len(self._seen) > 1 and self._seen[1].t_s <= t_s - LAG_S:
            self._seen.popleft()
        first = self._seen[0]
        lag_s = t_s - first.t_s
        if LAG_S <= lag_s <= 2.0 * LAG_S:
            known_m2 = 2.0 * white_m**2 + (lost_ratio * (way_m - first.way_m)) ** 2 / 2.0
            moved_m2 = abs(apart_m - first.apart_m) ** 2 / SQUARE_MEDIAN
            self._learn(t_s, (moved_m2 - known_m2) / lag_s)

    def _learn(self, t_s: float, walk_m2_per_s: float) -> None:
        self._walks.append((t_s, walk_m2_per_s))
        while self._walks[0][0] < t_s - MEMORY_S:
            self._walks.popleft()
        if t_s - self._walks[0][0] >= LEAST_S:
            middle = statistics.median(walk for _, walk in self._walks)
            self._walk_m_per_sqrt_s = math.sqrt(max(0.0, middle))

    def enlarge(self, size_m: float) -> None:
        """Know that the slow error is at least so large: fixes that jumped stay where they are."""
        self._least_size_m = max(self._least_size_m, size_m)

    def is_wide(self, noise: FixNoise, *, is_vouched: bool) -> bool:
        """Whether the receiver wanders faster than it states, or may do so unseen."""
        if math.isnan(self._walk_m_per_sqrt_s):
            return not is_vouched
        return self._walk_m_per_sqrt_s > SURE_WALK_RATIO * noise.bias_walk_m_per_sqrt_s

    def widen(self, noise: FixNoise, *, is_vouched: bool) -> FixNoise:
        """Believe what was learnt where it is surely more than what is stated."""
        stated, size_m = noise.bias_walk_m_per_sqrt_s, float(noise.bias_std_m)
        if not self.is_wide(noise, is_vouched=is_vouched):
            return msgspec.structs.replace(noise, bias_std_m=max(size_m, self._least_size_m))
        unseen = math.isnan(self._walk_m_per_sqrt_s)
        walk = UNSEEN_WALK_M_PER_SQRT_S if unseen else self._walk_m_per_sqrt_s
        walk = clamp(walk, stated, MOST_WALK_RATIO * stated)
        return msgspec.structs.replace(
            noise, bias_walk_m_per_sqrt_s=walk,
            bias_std_m=max(size_m, walk * math.sqrt(REFLECTION_S / 2.0)),
        )  # fmt: skip
