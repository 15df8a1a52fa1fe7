"""Whether the antenna sits where the robot's description has it, from the velocities of turns.

A turn moves an antenna that sits elsewhere by its rate times the difference. What wheels lose of
their way in a turn looks alike, but in a turn to the other side it has the other sign.
"""

from __future__ import annotations

import math

from agribot.core.facts import AntennaElsewhere

# Rate from which a velocity shows the antenna's arm.
LEAST_RATE_RADPS = 0.2
# Turn to each side after which the arm is judged.
LEAST_TURN_RAD = 2.0
# Difference that is named: robots turn about a place some centimetres off their middle.
NAMED_M, NAMED_SIGMA = 0.2, 5.0
# Largest difference between turns to both sides: wheels that a clod holds move the robot, too.
MOST_APART_M = 0.3


class _Side:
    """The arm, ahead and to the left, that turns to one side show beyond the stated one."""

    def __init__(self) -> None:
        self._square = self._ahead = self._left = self._noise = 0.0
        self.turned_rad = 0.0

    def add(self, off_mps: tuple[float, float], rate_radps: float, std_mps: float) -> None:
        ahead_mps, left_mps = off_mps
        self._square += rate_radps**2
        self._ahead += rate_radps * left_mps
        self._left -= rate_radps * ahead_mps
        self._noise += (rate_radps * std_mps) ** 2

    @property
    def arm_m(self) -> complex:
        return complex(self._ahead, self._left) / self._square

    @property
    def variance_m2(self) -> float:
        return self._noise / self._square**2


class AntennaWatch:
    """Call `add` with every velocity."""

    def __init__(self) -> None:
        self._sides = {1.0: _Side(), -1.0: _Side()}

    def forget(self) -> None:
        """Judge anew: a person has looked."""
        self._sides = {1.0: _Side(), -1.0: _Side()}

    def add(
        self, off_mps: tuple[float, float], rate_radps: float, std_mps: float, lasted_s: float
    ) -> None:
        """Take a velocity less that of the stated arm, ahead and left, in a robot that turns."""
        if abs(rate_radps) < LEAST_RATE_RADPS:
            return
        side = self._sides[math.copysign(1.0, rate_radps)]
        side.turned_rad += abs(rate_radps) * lasted_s
        side.add(off_mps, rate_radps, std_mps)

    @property
    def off_m(self) -> complex:
        """Offset ahead and to the left of the stated place; 0 until it is sure."""
        left, right = self._sides.values()
        if min(left.turned_rad, right.turned_rad) < LEAST_TURN_RAD:
            return 0j
        off_m = (left.arm_m + right.arm_m) / 2.0
        std_m = math.sqrt(left.variance_m2 + right.variance_m2) / 2.0
        is_one = abs(left.arm_m - right.arm_m) <= MOST_APART_M
        return off_m if is_one and abs(off_m) > max(NAMED_M, NAMED_SIGMA * std_m) else 0j

    def find(self, *, is_left_open: bool) -> AntennaElsewhere | None:
        """Find it elsewhere; `is_left_open`: a person has to look."""
        off_m = self.off_m
        if not off_m:
            return None
        if abs(off_m.imag) > abs(off_m.real):
            aside_m = abs(off_m.imag)
            return AntennaElsewhere(aside_m, "left" if off_m.imag > 0.0 else "right", is_left_open)
        ahead_m = abs(off_m.real)
        return AntennaElsewhere(ahead_m, "ahead" if off_m.real > 0.0 else "behind", is_left_open)
