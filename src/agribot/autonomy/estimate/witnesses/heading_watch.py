"""Whether the heading was put right by more at once than a robot that knew it can have been off.

The course of a robot that is carried aside looks to GNSS as if it had turned.
"""

from __future__ import annotations

import math
from collections import deque

from agribot.core.facts import HeadingJumped
from agribot.core.geo import wrap_rad

WINDOW_S = 1.0
# Corrections of a heading known to SURE_STD_RAD stay far below this; a gyro that is off by 0.3
# rad/s is named by the compass before it gets there.
JUMP_RAD, SURE_STD_RAD = math.radians(20.0), math.radians(6.0)


class HeadingWatch:
    """Call `add` with every estimate: the heading less what the gyro made of it, and its sigma."""

    def __init__(self) -> None:
        self._offsets: deque[tuple[float, float, float]] = deque()
        self._jump_rad = 0.0

    def add(self, t_s: float, off_rad: float, std_rad: float) -> None:
        offsets = self._offsets
        offsets.append((t_s, off_rad, std_rad))
        while t_s - offsets[0][0] > WINDOW_S:
            offsets.popleft()
        _, before_rad, before_std_rad = offsets[0]
        jump_rad = wrap_rad(off_rad - before_rad)
        if before_std_rad <= SURE_STD_RAD and abs(jump_rad) > JUMP_RAD:
            self._jump_rad = jump_rad

    def forget(self) -> None:
        """Take the heading as it is: a person has decided."""
        self._offsets.clear()
        self._jump_rad = 0.0

    @property
    def fault(self) -> HeadingJumped | None:
        """Jump that a person has not looked at yet."""
        return HeadingJumped(self._jump_rad) if self._jump_rad else None
