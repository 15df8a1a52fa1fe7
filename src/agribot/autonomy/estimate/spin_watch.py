"""Wheels that turn on the spot, seen by a receiver too noisy for its single velocities to tell."""

from __future__ import annotations

from typing import Generic

from agribot.autonomy.estimate.ekf import GNSS_BIAS_X, GNSS_BIAS_Y, WHEEL_SCALE, YAW, X, Y
from agribot.core.arithmetic import Arithmetic, Condition, Number

# Slip leaves more than half of the way, also in the worst soil that is driven.
LOST_RATIO = 0.5
# A robot that turns slowly, or stands across a slope, slides aside this fast and keeps its heading.
SLIDE_MPS = 0.1
# One that turns while a clod holds a wheel turns about that wheel: about this far off its middle.
CORNER_M = 0.5


class SpinWatch(Generic[Number]):
    """Means over the last fixes of what the wheels claim and of what the receiver misses of it.

    Of one robot or, with arrays, of many. A mean over eight fixes scatters by a quarter of the
    sigma of one, so a whole sigma is no chance. `aside_mps` is the mean of what the receiver goes
    to the left without the wheels: a wrong heading lasts, what jolts the robot aside does not.
    """

    def __init__(self, m: Arithmetic[Number], fixes: int) -> None:
        self._m: Arithmetic[Number] = m
        self._fixes = fixes
        self._claimed_mps: Number | float = 0.0
        self._missing_mps: Number | float = 0.0
        self.aside_mps: Number | float = 0.0

    def is_spinning(
        self, claimed_mps: Number, residual_mps: tuple[Number, Number], std_mps: Number
    ) -> Condition:
        """`residual_mps` is the receiver's velocity less the claimed one, ahead and to the left."""
        self._claimed_mps += (claimed_mps - self._claimed_mps) / self._fixes
        self._missing_mps -= (residual_mps[0] + self._missing_mps) / self._fixes
        self.aside_mps += (residual_mps[1] - self.aside_mps) / self._fixes
        is_less = self._missing_mps * self._claimed_mps > 0.0
        least_mps = self._m.most(std_mps, LOST_RATIO * abs(self._claimed_mps))
        spins: Condition = is_less & (abs(self._missing_mps) > least_mps)
        self._missing_mps = self._m.choose(spins, 0.0 * self._missing_mps, self._missing_mps)
        return spins


def ahead_and_aside(
    m: Arithmetic[Number], vector: tuple[Number, Number], yaw_rad: Number
) -> tuple[Number, Number]:
    """Resolve a vector of the map along the robot and to its left."""
    cos, sin = m.cos(yaw_rad), m.sin(yaw_rad)
    return cos * vector[0] + sin * vector[1], cos * vector[1] - sin * vector[0]


def doubts(
    m: Arithmetic[Number],
    residuals: tuple[Number, Number],
    expected_mps: tuple[Number, Number],
    yaw_rad: Number,
    lasting_aside_mps: Number | float,
    driven: tuple[Number, Number],
    lasted_s: float,
    *,
    is_corrected: bool,
) -> tuple[tuple[int, Number], ...]:
    """Say how far to open up for wheels that spin free (ahead), and a wrong heading (aside).

    `lasting_aside_mps` is the mean of what the receiver goes to the left without the wheels,
    `driven` what wheels and gyro say: m/s and rad/s.
    What a robot may slide aside says nothing of its heading.
    The bias of a receiver without corrections has meanwhile taken up what the wheels only claimed.
    """
    ahead_mps, aside_mps = ahead_and_aside(m, residuals, yaw_rad)
    # A mean reaches half of what lasts by the time at which the filter opens.
    lasting_mps = m.most(lasting_aside_mps, -lasting_aside_mps)
    aside_mps = m.least(abs(aside_mps), 2.0 * lasting_mps)
    driven_mps, rate_radps = driven
    slide_mps = SLIDE_MPS + CORNER_M * abs(rate_radps)
    speed_mps = m.most(m.sqrt(expected_mps[0] ** 2 + expected_mps[1] ** 2), 0.05)
    # Of wheels that are known to spin next to nothing is expected, and that has no direction.
    course_mps = m.most(speed_mps, abs(driven_mps))
    wrong_m = m.sqrt(residuals[0] ** 2 + residuals[1] ** 2) * lasted_s
    places = (X, Y) if is_corrected else (X, Y, GNSS_BIAS_X, GNSS_BIAS_Y)
    opened = [
        (WHEEL_SCALE, m.least(abs(ahead_mps) / speed_mps, 1.0)),
        (YAW, m.least(m.most(aside_mps - slide_mps, 0.0) / course_mps, 1.0)),
    ]
    for state in places:
        opened.append((state, wrong_m))
    return tuple(opened)
