"""Encoder counts of a left and a right wheel as the wheels of a robot."""

from __future__ import annotations

import math

from agribot.core.messages import WheelSample


class TickWheels:
    """Turns counts into angles and, between two readings, into speeds."""

    def __init__(self, ticks_per_turn: float) -> None:
        self._rad_per_tick = math.tau / ticks_per_turn
        self._last: tuple[float, float, float] | None = None

    def turn(self, t_s: float, left: float, right: float) -> WheelSample:
        """Return the wheels at a time, seconds of the log."""
        return self.turn_angles(t_s, left * self._rad_per_tick, right * self._rad_per_tick)

    def turn_angles(self, t_s: float, left_rad: float, right_rad: float) -> WheelSample:
        left_radps = right_radps = 0.0
        if self._last is not None and t_s > self._last[0]:
            dt_s = t_s - self._last[0]
            left_radps = (left_rad - self._last[1]) / dt_s
            right_radps = (right_rad - self._last[2]) / dt_s
        self._last = t_s, left_rad, right_rad
        return make_wheels((left_rad, right_rad), (left_radps, right_radps))


class SpeedWheels:
    """Turns speeds of a left and a right wheel into angles, which are these summed up."""

    def __init__(self) -> None:
        self._last_s: float | None = None
        self._left_rad = self._right_rad = 0.0

    def turn(self, t_s: float, left_radps: float, right_radps: float) -> WheelSample:
        dt_s = 0.0 if self._last_s is None else t_s - self._last_s
        self._last_s = t_s
        if 0.0 < dt_s < 1.0:
            self._left_rad += left_radps * dt_s
            self._right_rad += right_radps * dt_s
        return make_wheels((self._left_rad, self._right_rad), (left_radps, right_radps))


def make_wheels(angles_rad: tuple[float, float], speeds_radps: tuple[float, float]) -> WheelSample:
    """Make four wheels of a left and a right one."""
    (left_rad, right_rad), (left, right) = angles_rad, speeds_radps
    return WheelSample(
        t_s=0.0,
        angle_rad=(right_rad, left_rad, right_rad, left_rad),
        speed_radps=(right, left, right, left),
    )
