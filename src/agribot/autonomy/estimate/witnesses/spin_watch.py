"""Wheels that spin on the spot, seen by a receiver whose single velocities are too noisy."""

from __future__ import annotations

import math

from agribot.autonomy.estimate.filter.ekf import GNSS_BIAS_X, GNSS_BIAS_Y, WHEEL_SCALE, YAW, X, Y

# Slip leaves more than half of the way, also in the worst soil that is driven.
LOST_RATIO = 0.5
LEAST_CLAIM_MPS = 0.02  # wheels that turn slower stand, and do not spin
# A robot that turns slowly, or stands across a slope, slides aside this fast and keeps its heading.
SLIDE_MPS = 0.1
# One that turns while a clod holds a wheel turns about that wheel: about this far off its middle.
CORNER_M = 0.5


class SpinWatch:
    """Means over the last fixes of what the wheels claim and of what the receiver misses of it.

    A mean over eight fixes scatters by a quarter of the sigma of one, so a whole sigma is no
    chance. `aside_mps` is the mean of what the receiver goes to the left without the wheels: a
    wrong heading lasts, what jolts the robot aside does not.
    """

    def __init__(self, fixes: int) -> None:
        self._fixes = fixes
        self._claimed_mps = self._missing_mps = self.aside_mps = 0.0

    def is_spinning(
        self, claimed_mps: float, residual_mps: tuple[float, float], std_mps: float
    ) -> bool:
        """`residual_mps` is the receiver's velocity less the claimed one, ahead and to the left."""
        self._claimed_mps += (claimed_mps - self._claimed_mps) / self._fixes
        self._missing_mps -= (residual_mps[0] + self._missing_mps) / self._fixes
        self.aside_mps += (residual_mps[1] - self.aside_mps) / self._fixes
        turns = abs(self._claimed_mps) > LEAST_CLAIM_MPS
        is_less = turns and self._missing_mps * self._claimed_mps > 0.0
        least_mps = max(LOST_RATIO * abs(self._claimed_mps), std_mps)
        spins = is_less and abs(self._missing_mps) > least_mps
        if spins:
            self._missing_mps *= 0.0  # keeps its sign
        return spins


def moves_against(claimed_mps: float, shown_mps: float) -> bool:
    """Whether the robot goes the other way than its wheels claim: no soft ground does that."""
    return shown_mps * claimed_mps < 0.0 and abs(shown_mps) > LOST_RATIO * abs(claimed_mps)


def ahead_and_aside(vector: tuple[float, float], yaw_rad: float) -> tuple[float, float]:
    """Resolve a vector of the map along the robot and to its left."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * vector[0] + sin * vector[1], cos * vector[1] - sin * vector[0]


def doubts(
    residuals: tuple[float, float],
    expected_mps: tuple[float, float],
    yaw_rad: float,
    lasting_aside_mps: float,
    driven: tuple[float, float],
    lasted_s: float,
    *,
    is_corrected: bool,
) -> tuple[tuple[int, float], ...]:
    """Say how far to open up for wheels that spin free (ahead), and a wrong heading (aside).

    `lasting_aside_mps` is the mean of what the receiver goes to the left without the wheels,
    `driven` what wheels and gyro say: m/s and rad/s.
    What a robot may slide aside says nothing of its heading.
    The bias of a receiver without corrections has meanwhile taken up what the wheels only claimed.
    """
    ahead_mps, aside_mps = ahead_and_aside(residuals, yaw_rad)
    # A mean reaches half of what lasts by the time at which the filter opens.
    lasting_mps = max(-lasting_aside_mps, lasting_aside_mps)
    aside_mps = min(2.0 * lasting_mps, abs(aside_mps))
    driven_mps, rate_radps = driven
    slide_mps = SLIDE_MPS + CORNER_M * abs(rate_radps)
    speed_mps = max(0.05, math.sqrt(expected_mps[0] ** 2 + expected_mps[1] ** 2))
    # A spinning wheel is expected to make next to no way, and that has no direction.
    course_mps = max(abs(driven_mps), speed_mps)
    wrong_m = math.sqrt(residuals[0] ** 2 + residuals[1] ** 2) * lasted_s
    places = (X, Y) if is_corrected else (X, Y, GNSS_BIAS_X, GNSS_BIAS_Y)
    opened = [
        (WHEEL_SCALE, min(1.0, abs(ahead_mps) / speed_mps)),
        (YAW, min(1.0, max(0.0, aside_mps - slide_mps) / course_mps)),
    ]
    for state in places:
        opened.append((state, wrong_m))
    return tuple(opened)
