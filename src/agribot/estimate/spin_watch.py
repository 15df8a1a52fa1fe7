"""Wheels that turn on the spot, seen by a receiver too noisy for its single velocities to tell."""

from __future__ import annotations

from agribot.arithmetic import Arithmetic, Number

# Slip leaves more than half of the way, also in the worst soil that is driven.
LOST_RATIO = 0.5


class SpinWatch:
    """Means over the last fixes of what the wheels claim and of what the receiver misses of it.

    Of one robot or, with arrays, of many. A mean over eight fixes scatters by a quarter of the
    sigma of one, so a whole sigma is no chance.
    """

    def __init__(self, m: Arithmetic, fixes: int) -> None:
        self._m, self._fixes = m, fixes
        self._claimed_mps: Number = 0.0
        self._missing_mps: Number = 0.0

    def is_spinning(self, claimed_mps: Number, residual_mps: Number, std_mps: Number) -> Number:
        """`residual_mps` is the receiver's velocity along the robot less the claimed one."""
        self._claimed_mps += (claimed_mps - self._claimed_mps) / self._fixes
        self._missing_mps -= (residual_mps + self._missing_mps) / self._fixes
        is_less = self._missing_mps * self._claimed_mps > 0.0
        least_mps = self._m.most(std_mps, LOST_RATIO * abs(self._claimed_mps))
        spins = is_less & (abs(self._missing_mps) > least_mps)
        self._missing_mps = self._missing_mps * (1.0 - spins)
        return spins
