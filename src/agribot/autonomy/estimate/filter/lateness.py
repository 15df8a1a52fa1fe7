"""Samples that come late, and a clock that leaps."""

from __future__ import annotations

import math

from agribot.core.facts import ClockLeapt, ImuLate

# An IMU at the end of a cable is read within some hundredths of a second.
IMU_LATE_S, LASTS_S = 0.05, 0.5
NAMED_S = 15.0
# A leap is a gap in which wheels did not do half of what they did before and after it.
LEAP_S, LOST_RATIO, LEAST_MPS = 0.1, 0.5, 0.1


class Lateness:
    """Call `add` with the age of a sensor's newest sample; a single one that is new is enough."""

    def __init__(self) -> None:
        self._new_s = math.inf
        self.age_s = 0.0

    def add(self, now_s: float, newest_s: float) -> None:
        self.age_s = now_s - newest_s
        if self.age_s <= IMU_LATE_S or math.isinf(self._new_s):
            self._new_s = now_s

    def fault(self, now_s: float) -> ImuLate | None:
        is_new = now_s - self._new_s < LASTS_S or math.isinf(self.age_s)
        return None if is_new else ImuLate(self.age_s)


class LeapWatch:
    """Call `move` with every step of the wheels: the time it took by the clock, and its way."""

    def __init__(self) -> None:
        self._mps = 0.0
        self._leapt_s, self._t_s = 0.0, -math.inf

    def move(self, t_s: float, dt_s: float, distance_m: float, speed_mps: float) -> None:
        """`speed_mps` is what the encoders say of the end of the step."""
        before_mps, self._mps = self._mps, speed_mps
        if dt_s < LEAP_S or before_mps * speed_mps < LEAST_MPS**2:
            return
        mean_mps = (before_mps + speed_mps) / 2.0
        if abs(distance_m) < LOST_RATIO * abs(mean_mps) * dt_s:
            self._leapt_s, self._t_s = dt_s - abs(distance_m / mean_mps), t_s

    def fault(self, now_s: float) -> ClockLeapt | None:
        return None if now_s - self._t_s > NAMED_S else ClockLeapt(self._leapt_s)
