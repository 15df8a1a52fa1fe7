"""A creep of millimetres a second: fixes held against the sum of their velocities, for long.

The noise of a velocity is white, so that its sum parts from the truth by the root of the time, a
creep by the time itself. What is found is a doubt that widens the protection level: the robot then
stands, and by wheels that stand a creep shows within seconds (see `drift_watch`). One that has
ended meanwhile shows no more, so that a doubt stays until a person has looked.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from agribot.core.facts import GnssParts

WINDOWS_S = (20.0, 30.0, 40.0, 60.0, 80.0)
STEP_S = 1.0  # least distance of kept marks
# Lasting error of the velocities of a receiver with fixed ambiguities, 1 sigma, m/s. Not measured:
# a standing NEO-M8T, without them, showed 0.006 over 38 s (log ublox-neo-m8t of gpsd).
BIAS_MPS = 0.0015
# Receivers smooth velocities; their sum lags behind by the change of speed times some tenths.
LAG_STD_S = 0.1
# Squared distance in sigmas that is a doubt: of 1,500 drives of 300 s without a fault, and with
# velocities that are off by up to 2 mm/s for good, one exceeds it at most.
DOUBT2 = 4.5**2
# Smallest change of speed that has a direction.
LEAST_MPS = 1e-6
# A robot whose wheels stood for the shortest window has been judged by them.
STANDS_M = 0.01


class CreepMark(NamedTuple):
    """A fix less the sum of the velocities up to it, East + i North, and the squares of its gaps.

    `led_mps` is the velocity by wheels and filter, `way_m` the way of the wheels, `fixes_m2` the
    variance of a fix.
    """

    t_s: float
    off_m: complex
    gaps2_s2: float
    led_mps: complex
    way_m: float
    fix_m2: float


class Parted(NamedTuple):
    """Distance of fixes and velocities over a window, and 1 sigma of it."""

    window_s: float
    apart_m: complex
    std_m: float
    is_doubt: bool

    def bound_m(self, sigmas: float) -> float:
        """Bound how far fixes may have crept, anywhere."""
        return abs(self.apart_m) + sigmas * self.std_m


class SlowCreep:
    """Call `add` with every fix of carrier corrections; `doubt` is what was found.

    `widest` is the longest window: a creep of up to its distance may be there unseen.
    """

    def __init__(self) -> None:
        self._marks: deque[CreepMark] = deque()
        self.doubt: Parted | None = None
        self.widest: Parted | None = None

    @property
    def fault(self) -> GnssParts | None:
        doubt = self.doubt
        return None if doubt is None else GnssParts(abs(doubt.apart_m), doubt.window_s)

    def restart(self) -> None:
        """Forget all marks and what was said of them."""
        self._marks.clear()
        self.doubt = self.widest = None

    def add(self, here: CreepMark, velocity_mps: float, walk_m2_per_s: float) -> None:
        """Take a mark, 1 sigma of one velocity, and the walk of the slow error of fixes."""
        marks = self._marks
        if marks and here.t_s - marks[-1].t_s < STEP_S - 1e-6:
            return
        if self.doubt is None and self._has_stood(here):
            self.restart()
        self._judge(here, velocity_mps, walk_m2_per_s)
        marks.append(here)
        while here.t_s - marks[0].t_s > WINDOWS_S[-1] + STEP_S:
            marks.popleft()

    def _has_stood(self, here: CreepMark) -> bool:
        """Whether the wheels have stood for the shortest window, and so have judged the fixes."""
        then = self._find(here.t_s - WINDOWS_S[0])
        return then is not None and here.way_m - then.way_m < STANDS_M

    def _judge(self, here: CreepMark, velocity_mps: float, walk_m2_per_s: float) -> None:
        for window_s in WINDOWS_S:
            then = self._find(here.t_s - window_s)
            if then is None:
                return
            self.widest = parted = _compare(then, here, velocity_mps, walk_m2_per_s)
            if parted.is_doubt and (self.doubt is None or parted.std_m >= self.doubt.std_m):
                self.doubt = parted

    def _find(self, t_s: float) -> CreepMark | None:
        """Find the last mark up to a time; None before the first."""
        marks = self._marks
        if not marks or marks[0].t_s > t_s + STEP_S / 2.0:
            return None
        return next(mark for mark in reversed(marks) if mark.t_s <= t_s + STEP_S / 2.0)


def _compare(then: CreepMark, here: CreepMark, velocity_mps: float, walk_m2_per_s: float) -> Parted:
    """Measure how far fixes and velocities have parted, the lag of the latter left out."""
    lasted_s, apart_m = here.t_s - then.t_s, here.off_m - then.off_m
    fixes_m2 = then.fix_m2 + here.fix_m2 + walk_m2_per_s * lasted_s
    noise_m2 = velocity_mps**2 * (here.gaps2_s2 - then.gaps2_s2)
    variance_m2 = fixes_m2 + noise_m2 + (BIAS_MPS * lasted_s) ** 2
    change_mps = here.led_mps - then.led_mps
    lag_m2 = (LAG_STD_S * abs(change_mps)) ** 2
    lagging_m = _project(apart_m, change_mps)
    distance2 = (abs(apart_m) ** 2 - lagging_m**2) / variance_m2
    distance2 += lagging_m**2 / (variance_m2 + lag_m2)
    return Parted(lasted_s, apart_m, math.sqrt(variance_m2), distance2 > DOUBT2)


def _project(vector_m: complex, onto: complex) -> float:
    """Return the part of a vector along another one; 0 where that has no direction."""
    return (vector_m * onto.conjugate()).real / abs(onto) if abs(onto) > LEAST_MPS else 0.0
