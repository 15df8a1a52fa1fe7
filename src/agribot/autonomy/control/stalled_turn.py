"""A turn in which the wheels spin and the robot stands: a piece of it is taken on the spot.

A skid-steer robot that turns about its inner wheels lets these stand, and ground that gives way
holds them while the outer ones spin. Turned against each other, all wheels break loose.
"""

from __future__ import annotations

import math

# A robot that is held does not turn at all; rough soil leaves half of the yaw rate, shaken by a
# tenth of a radian a second.
STALLED_RATIO, STALLED_S = 0.15, 0.3
LEAST_RADPS = 0.3  # asked for; where a turn is wider, all wheels roll
PIECE_RAD, PIECE_RADPS = 0.3, 0.5
# Longest stalled turn; a robot that does not turn on the spot either is stuck, and the gate stops
# it.
LONGEST_S = 1.5


class StalledTurn:
    """Call `watch` in every step; while it gives a yaw rate, the robot turns on the spot."""

    def __init__(self) -> None:
        self._stalled_s = 0.0
        self._piece_radps = 0.0  # signed as the turn; 0 where no piece is taken
        self._turned_rad = self._lasted_s = 0.0
        self._is_stuck = False

    def restart(self) -> None:
        self._stalled_s = self._piece_radps = 0.0

    def watch(
        self, expected_radps: float, yaw_rate_radps: float, max_radps: float, dt_s: float
    ) -> float:
        """Compare the yaw rate that the commands should bring by now with the measured one."""
        if self._piece_radps:
            self._go_on(yaw_rate_radps, dt_s)
            return self._piece_radps
        if abs(yaw_rate_radps) >= LEAST_RADPS:
            self._is_stuck = False
        is_asked = abs(expected_radps) >= LEAST_RADPS and not self._is_stuck
        is_stalled = is_asked and yaw_rate_radps / expected_radps < STALLED_RATIO
        self._stalled_s = self._stalled_s + dt_s if is_stalled else 0.0
        if self._stalled_s >= STALLED_S:
            self._piece_radps = math.copysign(min(PIECE_RADPS, max_radps), expected_radps)
            self._turned_rad = self._lasted_s = 0.0
        return self._piece_radps

    def _go_on(self, yaw_rate_radps: float, dt_s: float) -> None:
        self._turned_rad += math.copysign(1.0, self._piece_radps) * yaw_rate_radps * dt_s
        self._lasted_s += dt_s
        self._is_stuck = self._lasted_s >= LONGEST_S and self._turned_rad < PIECE_RAD
        if self._is_stuck or self._turned_rad >= PIECE_RAD:
            self.restart()
