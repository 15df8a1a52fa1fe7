"""Whether camera and GNSS put the robot at the same place across the rows."""

from __future__ import annotations

import math
import statistics
from collections import deque

from agribot.core.facts import CameraAndGnssDisagree

# Window of the medians, which suppress outliers, weeds taken for crop and leaves in the wind.
WINDOW_S, MIN_LOOKS, MIN_FIXES = 2.0, 8, 8
# A camera that is mounted 3 cm and 1.5 degrees wrong, and fixes that are 2 cm off, differ by less.
NAMED_M = 0.10
# Half of a wheel's distance from the crop: the robot may follow either.
HALT_M = 0.15
LASTS_S, SETTLED_RATIO = 1.0, 0.8
# Rows that stand beside their map do so from the first look at a row on, within what fixes wander.
# They are believed after CONFIRM_M of way; beyond BESIDE_M a person decides: a wheel is near crop.
STEADY_M, CONFIRM_M, BESIDE_M = 0.06, 1.5, 0.28
# Time after which a report that is not repeated expires: two plants 2 m apart are passed in 10 s.
NAMED_S = 15.0
# Time after its last sighting for which a row holds the robot across it.
HELD_S = 2.0

Offsets = deque[tuple[float, float]]


class RowAgreement:
    """Call `add_look` for what the camera says, `add_fix` for GNSS; both against the same pose.

    All offsets are metres to the right of the rows by which a sensor puts the robot elsewhere than
    the pose, so that the pose itself drops out of their difference.
    """

    def __init__(self) -> None:
        self._looks: Offsets = deque()
        self._fixes: Offsets = deque()
        self._since_s: float | None = None
        self._named_t_s = -math.inf
        self._held_t_s = -math.inf
        self._way_m = 0.0
        self._entry_m: tuple[float, float, float] | None = None  # way, least and most since
        self.apart_m = 0.0  # lasting disagreement, 0 without one
        self.must_halt = False

    def add_look(self, t_s: float, off_m: float) -> None:
        _add(self._looks, t_s, off_m)
        self._evaluate(t_s)

    def testify(self, t_s: float, off_m: float) -> None:
        """Take what several plants of a row show together: it needs no more witnesses."""
        _drop_old(self._fixes, t_s)
        if len(self._fixes) < MIN_FIXES:
            return
        self._looks.clear()
        self._looks.append((t_s, off_m))
        apart_m = abs(off_m - _middle(self._fixes))
        if not self._settle(apart_m):
            self._name(t_s, apart_m)

    def add_fix(self, t_s: float, off_m: float) -> None:
        _add(self._fixes, t_s, off_m)

    def move(self, distance_m: float) -> None:
        """Count the way that the robot drives."""
        self._way_m += abs(distance_m)

    def enter_row(self) -> None:
        """Note that the looks from now on are at another row, or at one once again."""
        self._looks.clear()
        self._entry_m = self._since_s = None
        if not self.must_halt:
            self.apart_m = 0.0

    def hold(self, t_s: float) -> None:
        """Note that the filter took in what the camera saw of a row."""
        self._held_t_s = max(self._held_t_s, t_s)

    def release(self) -> None:
        """Note that what the camera saw until now was wrong."""
        self._looks.clear()
        self._held_t_s = -math.inf

    def is_held(self, t_s: float) -> bool:
        """Whether the camera holds the robot on its row, whatever GNSS says."""
        return t_s - self._held_t_s <= HELD_S

    @property
    def doubted_m(self) -> float:
        """Distance of camera and fixes, as long as it is open which of them is right."""
        return 0.0 if self._is_beside else self.apart_m

    @property
    def _is_beside(self) -> bool:
        """Whether it is the row that stands elsewhere, and neither camera nor fixes that moved."""
        if self._entry_m is None or self.must_halt or not self._is_steady:
            return False
        return self._way_m - self._entry_m[0] >= CONFIRM_M

    @property
    def _is_steady(self) -> bool:
        return self._entry_m is not None and self._entry_m[2] - self._entry_m[1] <= STEADY_M

    def agrees_with_fixes(self, t_s: float) -> bool:
        """Whether there are fixes that put the robot where the pose has it."""
        return self.bears_out(t_s, 0.0)

    def bears_out(self, t_s: float, off_m: float) -> bool:
        """Whether fixes put the robot where a look does."""
        _drop_old(self._fixes, t_s)
        has_fixes = len(self._fixes) >= MIN_FIXES
        return has_fixes and abs(off_m - _middle(self._fixes)) < NAMED_M

    @property
    def shown_m(self) -> tuple[float, float]:
        """Places by camera and fixes, to the right of the pose."""
        return _middle(self._looks), _middle(self._fixes)

    @property
    def fault(self) -> CameraAndGnssDisagree | None:
        off_m = self.doubted_m
        return CameraAndGnssDisagree(off_m, is_left_open=False) if off_m else None

    def expire(self, t_s: float) -> None:
        """Drop a disagreement that was reported long ago, unless a person has to decide."""
        if self.apart_m and not self.must_halt and t_s - self._named_t_s > NAMED_S:
            self._since_s, self.apart_m = None, 0.0

    def forget(self) -> None:
        """Drop all that was seen: a person has decided."""
        self._looks.clear()
        self._fixes.clear()
        self._entry_m = None
        self._since_s, self.apart_m, self.must_halt = None, 0.0, False

    def _evaluate(self, t_s: float) -> None:
        _drop_old(self._fixes, t_s)
        if len(self._looks) < MIN_LOOKS or len(self._fixes) < MIN_FIXES:
            return
        looks_m, fixes_m = self.shown_m
        self._compare_with_entry(looks_m - fixes_m)
        apart_m = abs(looks_m - fixes_m)
        if self._settle(apart_m):
            return
        self._since_s = t_s if self._since_s is None else self._since_s
        if t_s - self._since_s >= LASTS_S:
            self._name(t_s, apart_m)

    def _compare_with_entry(self, apart_m: float) -> None:
        """Follow how steady camera and fixes are apart since the first looks at this row."""
        way_m, least_m, most_m = self._entry_m or (self._way_m, apart_m, apart_m)
        self._entry_m = way_m, min(least_m, apart_m), max(most_m, apart_m)

    def _settle(self, apart_m: float) -> bool:
        """Whether camera and fixes agree; then nothing is left of a disagreement."""
        if apart_m >= NAMED_M * (SETTLED_RATIO if self.apart_m else 1.0):
            return False
        self._since_s, self.apart_m, self.must_halt = None, 0.0, False
        return True

    def _name(self, t_s: float, apart_m: float) -> None:
        self.apart_m, self._named_t_s = apart_m, t_s
        limit_m = BESIDE_M if self._is_steady else HALT_M
        self.must_halt = self.must_halt or apart_m >= limit_m


def _add(offsets: Offsets, t_s: float, off_m: float) -> None:
    offsets.append((t_s, off_m))
    _drop_old(offsets, t_s)


def _drop_old(offsets: Offsets, t_s: float) -> None:
    while offsets and t_s - offsets[0][0] > WINDOW_S:
        offsets.popleft()


def _middle(offsets: Offsets) -> float:
    return statistics.median(off_m for _, off_m in offsets) if offsets else 0.0
