"""Correct the wheels' way by the receiver's velocities: on clods, and in turns on them.

Wheels and gyro measure the way to millimetres as long as the wheels grip. Where they do not, the
robot is off by a decimetre after some metres, and fixes without fixed ambiguities are too far off
to show it. The velocities come from the carrier's Doppler shift: the mean of two of them,
times the time in between, is the way of the antenna to millimetres or a centimetre, whatever the
wheels do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from agribot.autonomy.estimate.witnesses.spin_watch import CORNER_M, SLIDE_MPS

# 1 sigma of the error of wheels that have lost their way: large, so that nothing else is learnt
# from it. A clod pushes for seconds, which a heading must not be blamed for.
LOST_MPS = 10.0
# Wheels that are off by three sigmas of a velocity have lost it, and for a while they are believed
# only where they agree with it: what they lose ahead is soon learnt, and then they still slide
# aside.
LOST_SIGMA2, LOST_S, STILL_SIGMA2 = 9.0, 2.0, 4.0
# Velocities of a larger 1 sigma lead nowhere that wheels do not, even where these slip. Nor do
# those of receivers that state none (0.1 m/s, times models.VELOCITY_FACTOR): many smooth them.
MAX_STD_MPS = 0.13
# Turn rate from which soft ground takes a third of the way and more.
TURNING_RADPS = 0.1


class LedVelocity(NamedTuple):
    """A velocity, and where wheels and gyro had led the antenna until then, East + i North."""

    t_s: float
    velocity_mps: complex
    led_m: complex


def have_lost_way(off_ahead_mps: float, variance: float, *, is_steady: bool) -> bool:
    """Return whether wheels are off by more than noise; `is_steady`: they were so for a while.

    `off_ahead_mps` is what they lack of the velocity of the receiver, along the robot: to the side
    a wrong heading would look the same.
    """
    return is_steady and off_ahead_mps * off_ahead_mps > LOST_SIGMA2 * variance


def are_fixes_vague(rate_radps: float, *, is_corrected: bool, is_float: bool) -> bool:
    """Return whether fixes measure the way of some seconds worse than velocities do.

    Fixes with float ambiguities always do. So do those without corrections, but their velocities
    are no better than wheels that grip: they count where the robot turns.
    """
    return is_float if is_corrected else abs(rate_radps) > TURNING_RADPS


def find_beyond_wheels(
    shown_mps: tuple[float, float], driven: tuple[float, float], std_mps: float
) -> tuple[float, float]:
    """Find what wheels cannot have moved the robot by, however much way they lose: m/s.

    `shown_mps` is how its middle moves ahead and aside, with 1 sigma `std_mps`, `driven` what
    wheels and gyro say: m/s and rad/s. 0 is what they can: no faster than they turn, not the other
    way, and aside as far as soft ground lets a robot slide.
    """
    (ahead_mps, aside_mps), (driven_mps, rate_radps) = shown_mps, driven
    margin_mps, slide_mps = 3.0 * std_mps, _bound_slide_mps(rate_radps, std_mps)
    back_mps, fast_mps = min(0.0, driven_mps) - margin_mps, max(0.0, driven_mps) + margin_mps
    return (
        ahead_mps - min(fast_mps, max(back_mps, ahead_mps)),
        aside_mps - min(slide_mps, max(-slide_mps, aside_mps)),
    )


def find_beyond_speed(
    shown_mps: tuple[float, float], driven: tuple[float, float], std_mps: float
) -> tuple[float, float]:
    """Find what wheels cannot have moved the robot by, whatever it faces: m/s, as in the above."""
    speed_mps = math.hypot(*shown_mps)
    driven_mps, rate_radps = driven
    most_mps = abs(driven_mps) + _bound_slide_mps(rate_radps, std_mps)
    share = max(0.0, 1.0 - most_mps / speed_mps) if speed_mps > 0.0 else 0.0
    return shown_mps[0] * share, shown_mps[1] * share


def _bound_slide_mps(rate_radps: float, std_mps: float) -> float:
    """Bound how fast soft ground lets a robot slide aside, as velocities of that sigma show it."""
    return SLIDE_MPS + CORNER_M * abs(rate_radps) + 3.0 * std_mps


def can_be_of_wheels(
    shown_mps: tuple[float, float], driven: tuple[float, float], std_mps: float
) -> bool:
    """Return whether velocities show that the wheels move the robot: it is not carried."""
    ahead_mps, aside_mps = find_beyond_wheels(shown_mps, driven, std_mps)
    return std_mps <= MAX_STD_MPS and ahead_mps == 0.0 and aside_mps == 0.0
