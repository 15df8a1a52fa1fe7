"""How much of a commanded yaw rate the soil lets the robot have."""

from __future__ import annotations

import math

from agribot.core.arithmetic import clamp

MEMORY_S = 3.0  # memory in seconds of turning: one headland turn's value serves the next
PRIOR_RAD2PS = 0.05  # weight of "all of it", about 0.15 s of turning
MIN_RATE_RADPS = 0.1  # slower than this, disturbances outweigh the command
MIN_MOVING_RATIO = 0.5
LOWEST_RATIO, HIGHEST_RATIO = 0.5, 1.5


class YawGain:
    """Least squares of measured on commanded yaw rate, forgetting old turns.

    A skid-steer drive scrubs its tyres sideways, so its effective track, and with it the yaw
    rate of given wheel speeds, changes with the ground.
    """

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s
        self._expected_radps = 0.0
        self._together = self._power = PRIOR_RAD2PS

    @property
    def expected_radps(self) -> float:
        """Rate sent earlier, delayed like the drive."""
        return self._expected_radps

    @property
    def ratio(self) -> float:
        return clamp(self._together / self._power, LOWEST_RATIO, HIGHEST_RATIO)

    def learn(
        self, sent_v_mps: float, sent_radps: float, v_mps: float, yaw_rate_radps: float, dt_s: float
    ) -> None:
        """Compare what was sent last with what the robot does; only while it really drives."""
        self._expected_radps += (sent_radps - self._expected_radps) * dt_s / (self._lag_s + dt_s)
        expected_radps = self._expected_radps
        is_driving = v_mps > MIN_MOVING_RATIO * sent_v_mps > 0.0
        if not is_driving or abs(expected_radps) < MIN_RATE_RADPS:
            return
        if not math.isfinite(yaw_rate_radps):
            return
        kept = 1.0 - dt_s / MEMORY_S
        self._together = kept * self._together + expected_radps * yaw_rate_radps * dt_s
        self._power = kept * self._power + expected_radps * expected_radps * dt_s
