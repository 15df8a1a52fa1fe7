"""A steady heading from a noisy compass and a gyro alone, without GNSS or wheels."""

from __future__ import annotations

import math
from collections import deque

from agribot.core.geo import wrap_rad

WINDOW = 7


def circular_median(angles_rad: list[float]) -> float:
    """Find the sample with the smallest sum of arcs to all others; no direction is special.

    Of an even number, the middle between the two best. Raises: ValueError: the list is empty.
    """
    if not angles_rad:
        raise ValueError("the median of no angles is not defined; give at least one")
    ranked = sorted(angles_rad, key=lambda a: sum(abs(wrap_rad(a - b)) for b in angles_rad))
    if len(ranked) % 2:
        return ranked[0]
    return wrap_rad(ranked[0] + wrap_rad(ranked[1] - ranked[0]) / 2.0)


class HeadingFilter:
    """Sliding circular median, then a one-dimensional Kalman filter that the gyro predicts.

    Samples in the window are first turned by what the gyro saw since, so the median does not
    lag in a turn. A median of n samples has pi/2 of the variance of their mean, and neighbouring
    medians share samples, so their noise counts n times: together pi/2 of one sample's variance.
    `raw_std_rad` is the scatter of one compass sample, `walk_rad_per_sqrt_s` that of the
    integrated rate, whose bias has to be removed by the caller.
    """

    def __init__(self, raw_std_rad: float = 0.28, walk_rad_per_sqrt_s: float = 0.0026) -> None:
        self.variance_rad2 = math.inf
        self._median_variance = math.pi / 2.0 * raw_std_rad**2
        self._walk_rad2_per_s = walk_rad_per_sqrt_s**2
        self._window_rad: deque[float] = deque(maxlen=WINDOW)
        self._yaw_rad = 0.0
        self._t_s: float | None = None

    def update(self, t_s: float, raw_yaw_rad: float, yaw_rate_radps: float) -> float:
        """Take a compass sample and the mean yaw rate since the last one; returns the heading.

        A sample that is not finite, or not newer than the last, changes nothing.
        """
        if not math.isfinite(raw_yaw_rad + yaw_rate_radps + t_s):
            return self._yaw_rad
        if self._t_s is not None:
            dt_s = t_s - self._t_s
            if dt_s <= 0.0:
                return self._yaw_rad
            self._turn(yaw_rate_radps * dt_s)
            self.variance_rad2 += self._walk_rad2_per_s * dt_s
        self._t_s = t_s
        self._window_rad.append(raw_yaw_rad)
        median_rad = circular_median(list(self._window_rad))
        if math.isinf(self.variance_rad2):
            self._yaw_rad, self.variance_rad2 = median_rad, self._median_variance
            return self._yaw_rad
        gain = self.variance_rad2 / (self.variance_rad2 + self._median_variance)
        self._yaw_rad = wrap_rad(self._yaw_rad + gain * wrap_rad(median_rad - self._yaw_rad))
        self.variance_rad2 *= 1.0 - gain
        return self._yaw_rad

    def _turn(self, angle_rad: float) -> None:
        self._yaw_rad = wrap_rad(self._yaw_rad + angle_rad)
        for index, sample_rad in enumerate(self._window_rad):
            self._window_rad[index] = wrap_rad(sample_rad + angle_rad)
