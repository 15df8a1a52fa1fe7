"""Driving to one point: the original's law by distance and heading error, in its regions.

A robot that turns at the commanded rate is an integrator and needs no derivative term, so the input
rate does not matter.
"""

from __future__ import annotations

import math

import msgspec

from agribot.core.messages import STOP, DriveCommand


class GoToGoalSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Turn in place above `spin_rad`; from there to `straight_rad` slower, below it full speed."""

    speed_mps: float = 0.4
    slow_speed_mps: float = 0.2
    spin_rad: float = math.radians(30.0)
    straight_rad: float = math.radians(5.0)
    gain_per_s: float = 1.0
    max_yaw_rate_radps: float = 0.5
    arrive_m: float = 0.5
    depart_m: float = 0.2  # beyond arrive_m: a goal farther away is a new one
    timeout_s: float = 1.0  # largest age of either input


class GoToGoal:
    """Takes distance and heading error as they arrive; gives a twist on request."""

    def __init__(self, settings: GoToGoalSettings) -> None:
        self._settings = settings
        self._distance_m = self._error_rad = math.nan
        self._distance_s = self._error_s = -math.inf
        self.has_arrived = False
        self.reason = "no goal yet"

    def update_distance(self, t_s: float, distance_m: float) -> None:
        """Take the distance to the goal, metres; a negative or infinite one counts as silence."""
        if not (math.isfinite(distance_m) and distance_m >= 0.0):
            return
        self._distance_m, self._distance_s = distance_m, t_s
        settings = self._settings
        if distance_m <= settings.arrive_m:
            self.has_arrived = True
        elif distance_m > settings.arrive_m + settings.depart_m:
            self.has_arrived = False

    def update_error(self, t_s: float, error_rad: float) -> None:
        """Bearing of the goal minus heading, counter-clockwise positive."""
        if math.isfinite(error_rad):
            self._error_rad, self._error_s = error_rad, t_s

    def command(self, t_s: float) -> DriveCommand:
        """Give the twist of now; `reason` says why the robot stands."""
        settings = self._settings
        self.reason = self._why_standing(t_s)
        if self.reason:
            return STOP
        error_rad = math.remainder(self._error_rad, math.tau)
        limit = settings.max_yaw_rate_radps
        yaw_rate_radps = max(-limit, min(limit, settings.gain_per_s * error_rad))
        if abs(error_rad) > settings.spin_rad:
            v_mps = 0.0
        elif abs(error_rad) > settings.straight_rad:
            v_mps = settings.slow_speed_mps
        else:
            v_mps = settings.speed_mps
        return DriveCommand(v_mps=v_mps, yaw_rate_radps=yaw_rate_radps)

    def _why_standing(self, t_s: float) -> str:
        timeout_s = self._settings.timeout_s
        if not t_s - self._distance_s <= timeout_s:
            return f"no distance for {timeout_s:g} s"
        if not t_s - self._error_s <= timeout_s:
            return f"no heading error for {timeout_s:g} s"
        return "at the goal" if self.has_arrived else ""
