"""Whether the fixes have the robot on its mark, for as long as its wheels have not moved it off."""

from __future__ import annotations

import statistics
from collections import deque

from agribot.autonomy.estimate.filter.start import StartMark
from agribot.core.facts import StartAside

# Number of fixes whose median is a position, so that no single one can spoil it.
FIRST_FIXES = 5
# Way of the wheels after which they show by themselves that fixes jump, m.
SET_OFF_M = 0.1


class MarkCheck:
    """Compares fixes with the mark; `fault` is how they contradict each other.

    A receiver fixes its ambiguities some time after its first position, and a base may be moved
    before the robot sets off, so that fixed ambiguities are compared until then. A robot that does
    not stand at its mark is compared until it does: it may be carried or driven there by hand.
    """

    def __init__(self, mark: StartMark) -> None:
        self.fault: StartAside | None = None
        self._mark = mark
        self._places_m: deque[complex] = deque(maxlen=FIRST_FIXES)
        self._is_fixed = self._has_set_off = False

    def begin(
        self, off_m: complex, std_m: float, slack_m: float, *, is_fixed: bool
    ) -> StartAside | None:
        """Compare the first position, which is `off_m` from the mark."""
        self._is_fixed = is_fixed
        self.fault = self._mark.position_fault(off_m, std_m, slack_m, is_fixed=is_fixed)
        return self.fault

    def add(
        self,
        place_m: complex,
        std_m: float,
        moved_m: float,
        *,
        is_fixed: bool,
        is_followed: bool,
    ) -> StartAside | None:
        """Compare a fix; `moved_m` is the way of the wheels.

        The pose of a filter that rejects the fix (not `is_followed`) may not be at the mark yet.
        """
        if not self._counts(moved_m, is_fixed=is_fixed):
            return self.fault
        self._places_m.append(place_m)
        if len(self._places_m) == FIRST_FIXES:
            fault = self._mark.position_fault(self._find_off_m(), std_m, is_fixed=is_fixed)
            if fault is not None or is_followed:
                self.fault = fault
        return self.fault

    def _counts(self, moved_m: float, *, is_fixed: bool) -> bool:
        """Return whether a fix is compared; without ambiguities fixed only until one has them."""
        self._has_set_off = self.fault is None and (self._has_set_off or moved_m > SET_OFF_M)
        if self._has_set_off or self._mark.xy_map_m is None:
            return False
        if is_fixed and not self._is_fixed:
            self._is_fixed = True
            self._places_m.clear()
        return is_fixed or (self.fault is not None and not self._is_fixed)

    def _find_off_m(self) -> complex:
        east_m = statistics.median(place.real for place in self._places_m)
        north_m = statistics.median(place.imag for place in self._places_m)
        return complex(east_m, north_m) - complex(*(self._mark.xy_map_m or (east_m, north_m)))
