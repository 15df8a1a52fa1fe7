"""How a skid-steer robot turns on its wheels, from their places alone."""

from __future__ import annotations

import math
from collections.abc import Sequence

TINY = 1e-12
HALVINGS = 60


def compute_yaw_multiplier(arms_m: Sequence[float], half_track_m: float) -> float:
    """Compute the effective separation over the track of a robot that turns on the spot.

    `arms_m` are the places of its wheels along the body, from their middle. All carry the same and
    slide with Coulomb friction; the torque of the wheels' drive is that of their sliding aside.
    Four wheels at arms a and half track b give (a^2 + b^2) / b^2.
    """

    def balance(slip: float) -> float:
        """Return the torque left, for a slip along the wheel by `slip` times the yaw rate."""
        return sum(
            (half_track_m * slip - arm**2) / math.sqrt(slip**2 + arm**2 + TINY) for arm in arms_m
        )

    low, high = 0.0, max(arm**2 for arm in arms_m) / half_track_m
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (low, middle) if balance(middle) > 0.0 else (middle, high)
    return 1.0 + low / half_track_m
