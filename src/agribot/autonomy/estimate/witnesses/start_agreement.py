"""Whether fixes, the mark, the place where the robot was left and the rows in view agree."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from agribot.autonomy.estimate.filter.start import StartMark
from agribot.autonomy.estimate.witnesses.place_claims import (
    AGREE_SIGMA,
    PlaceClaim,
    claim_across,
    claim_place,
    find_disagreement,
)
from agribot.core.config import FieldConfig
from agribot.core.facts import StartAside

# Number of fixes whose median is a position, so that no single one can spoil it.
FIRST_FIXES = 5
# Number of looks at the rows that are a claim, and of those that are kept.
LEAST_LOOKS, MOST_LOOKS = 8, 16
# Way of the wheels after which they show by themselves that fixes jump, m.
SET_OFF_M = 0.1
# Way on which the rows in view have a say, m. Later the agreement of rows and fixes has it.
FIRST_WAY_M = 1.0
# 1 sigma of the place where a robot was left, its error and that of its wheels on soil, m.
LEFT_STD_M = 0.03
# Distance from which a robot was surely moved since it was left, m.
MOVED_M = 30.0
# 1 sigma of where a camera that is mounted with care shows a row, m.
MOUNT_STD_M = 0.03


class _Look(NamedTuple):
    """A place by the rows in view, less the way until then."""

    place_m: complex
    right: complex
    std_m: float


class StartAgreement:
    """Collects what is claimed of the start; `fault` is how that contradicts itself.

    A receiver fixes its ambiguities some time after its first position, and a base may be moved
    before the robot sets off, so that fixes are compared until then. A robot that does not stand
    at its mark is compared until it does: it may be carried or driven there by hand.
    It `is_over` after the first metre. `way_m` is where wheels and gyro have led since the first
    tick, in the map.
    """

    def __init__(self, mark: StartMark, field: FieldConfig) -> None:
        self.fault: StartAside | None = None
        self._mark, self._row_map_std_m = mark, field.row_map_std_m
        self._left_m = field.left_map_m
        self._fixes_m: deque[complex] = deque(maxlen=FIRST_FIXES)
        self._looks: deque[_Look] = deque(maxlen=MOST_LOOKS)
        self._fix_std_m = self._slack_m = 0.0
        self._from_m = self._way_m = 0j
        self._is_fixed = self._has_set_off = self.is_over = False

    def begin(
        self, place_m: complex, std_m: float, way_m: complex, slack_m: float, *, is_fixed: bool
    ) -> None:
        """Compare the first position; `slack_m` is how far off `way_m` may be."""
        self._slack_m, self._way_m = slack_m, way_m
        self._fixes_m.extend([place_m - way_m] * FIRST_FIXES)
        self._fix_std_m, self._is_fixed = std_m, is_fixed
        self.fault = self._find_fault()

    def add_fix(
        self,
        place_m: complex,
        std_m: float,
        way_m: complex,
        driven_m: float,
        *,
        is_fixed: bool,
        is_followed: bool,
    ) -> None:
        """Compare a fix; `driven_m` is the way of the wheels.

        The pose of a filter that rejects the fix (not `is_followed`) may not be at the mark yet.
        """
        if not self._counts(driven_m, is_fixed=is_fixed):
            return
        self._follow(way_m)
        if is_fixed or self._awaits_fixes:
            self._fixes_m.append(place_m - way_m)
            self._fix_std_m = std_m
        if len(self._fixes_m) == FIRST_FIXES:
            fault = self._find_fault()
            if fault is not None or is_followed:
                self.fault = fault

    def add_look(self, place_m: complex, std_m: float, way_m: complex, right: complex) -> None:
        """Take where the rows in view have the robot, across them."""
        std_m = math.hypot(std_m, self._row_map_std_m, MOUNT_STD_M)
        self._looks.append(_Look(place_m - way_m, right, std_m))

    def accept(self) -> None:
        """Take a person's word: the robot was moved since it was left, and the rows are looked at.

        The mark keeps its say until the robot sets off.
        """
        self._left_m = None
        self._looks.clear()
        self.is_over = self._has_set_off
        has_claims = bool(self._fixes_m) and not self.is_over
        self.fault = self._find_fault() if has_claims else None

    def _counts(self, driven_m: float, *, is_fixed: bool) -> bool:
        """Return whether a fix is compared; without ambiguities fixed only until one has them."""
        self._has_set_off = self._has_set_off or (self.fault is None and driven_m > SET_OFF_M)
        if driven_m > FIRST_WAY_M and self.fault is None:
            self.is_over = True
        if self.is_over or (self._has_set_off and not self._looks):
            return False
        if is_fixed and not self._is_fixed:
            self._is_fixed = True
            self._fixes_m.clear()
        is_asked = self.fault is not None or bool(self._looks)
        return is_fixed or (is_asked and not self._is_fixed)

    @property
    def _awaits_fixes(self) -> bool:
        """Whether fixes put the robot elsewhere; else the mark has shown their slow error."""
        return self.fault is not None and self.fault.accuser == "gnss"

    def _follow(self, way_m: complex) -> None:
        """Move the start along until the robot sets off; a robot elsewhere is brought to it."""
        self._way_m = way_m
        if not self._has_set_off:
            self._from_m, self._slack_m = way_m, 0.0

    def _find_fault(self) -> StartAside | None:
        return find_disagreement([*self._list_claims()])

    def _list_claims(self) -> Iterable[PlaceClaim]:
        yield claim_place("gnss", self._find_place_m(), self._find_fix_std_m())
        if len(self._looks) >= LEAST_LOOKS:
            yield self._claim_by_rows()
        way_m, mark_m, yaw_std_rad = self._way_m, self._mark.xy_map_m, self._mark.yaw_std_rad
        if mark_m is not None:
            since_m = way_m - self._from_m
            std_m = self._mark.std_m + self._slack_m / AGREE_SIGMA + abs(since_m) * yaw_std_rad
            yield claim_place("mark", complex(*mark_m) + since_m, std_m)
        if self._left_m is not None:
            left_m = complex(*self._left_m) + way_m
            if abs(left_m - self._find_place_m()) < MOVED_M:
                yield claim_place("left", left_m, LEFT_STD_M + abs(way_m) * yaw_std_rad)

    def _find_place_m(self) -> complex:
        east_m = statistics.median(place.real for place in self._fixes_m)
        north_m = statistics.median(place.imag for place in self._fixes_m)
        return complex(east_m, north_m) + self._way_m

    def _find_fix_std_m(self) -> float:
        """Return 1 sigma of the fixes; without fixed ambiguities they are off by a metre."""
        least_m = 0.0 if self._is_fixed else self._mark.misplaced_m / AGREE_SIGMA
        return max(self._fix_std_m, least_m)

    def _claim_by_rows(self) -> PlaceClaim:
        """Take the median of the looks across the rows: a weed and a leaf stand beside them."""
        last = self._looks[-1]
        across_m = statistics.median(
            (look.place_m * last.right.conjugate()).real for look in self._looks
        )
        way_m = (self._way_m * last.right.conjugate()).real
        return claim_across("rows", (across_m + way_m) * last.right, last.std_m, last.right)
