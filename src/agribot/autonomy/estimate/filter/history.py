"""Where the robot was a moment ago, so that a late measurement meets the pose of its own epoch."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import msgspec


class Motion(msgspec.Struct, gc=False):
    """A point of the dead-reckoned track, with the wheel speed (uncorrected) and yaw rate there."""

    t_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    wheel_mps: float
    yaw_rate_radps: float


# Start of the odometry.
UNMOVED = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Epoch(NamedTuple):
    """Motion at the capture of a sample and now, and the time since the sample before."""

    then: Motion
    now: Motion
    since_last_s: float = math.inf


class MotionHistory:
    """Ring of dead-reckoned motion since the start, in the map's axes.

    Corrections of the filter never enter it: the difference of two points is pure motion, also
    when the filter jumped in between. Its yaw is not wrapped.
    """

    def __init__(self, capacity: int = 512, ahead_s: float = 0.3) -> None:
        self._ring: deque[Motion] = deque(maxlen=capacity)
        self._ahead_s = ahead_s

    def append(self, motion: Motion) -> None:
        self._ring.append(motion)

    @property
    def newest(self) -> Motion | None:
        return self._ring[-1] if self._ring else None

    def epoch(self, t_s: float) -> Epoch | None:
        """Find the motion at a time and now; None when that is no longer or not yet known."""
        now, then = self.newest, self.at(t_s)
        return None if now is None or then is None else Epoch(then, now)

    def at(self, t_s: float) -> Motion | None:
        """Interpolate the motion at a time; None when it is no longer or not yet known."""
        later: Motion | None = None
        for motion in reversed(self._ring):
            if motion.t_s <= t_s:
                return self._ahead(motion, t_s) if later is None else _between(motion, later, t_s)
            later = motion
        return None

    def _ahead(self, newest: Motion, t_s: float) -> Motion | None:
        """Extrapolate a little ahead of the wheels: they go on as they did."""
        if t_s - newest.t_s > self._ahead_s:
            return None
        return _between(self._ring[-2], newest, t_s) if len(self._ring) > 1 else newest


def _between(a: Motion, b: Motion, t_s: float) -> Motion:
    part = (t_s - a.t_s) / (b.t_s - a.t_s)
    return Motion(
        t_s,
        a.x_m + part * (b.x_m - a.x_m),
        a.y_m + part * (b.y_m - a.y_m),
        a.yaw_rad + part * (b.yaw_rad - a.yaw_rad),
        a.wheel_mps + part * (b.wheel_mps - a.wheel_mps),
        a.yaw_rate_radps + part * (b.yaw_rate_radps - a.yaw_rate_radps),
    )
