"""A camera that was knocked or slides off: its row line held against wheels, gyro and itself.

Two witnesses show how the robot moved across the row over the last metres: wheels with gyro,
aligned as the filter believed then, and the line's own direction along the way. A line that has
moved aside against both of them is a fault of the camera; where a row bends that the map has
straight, the line's direction bends with it. Several windows are compared, since a jump shows in a
short one and a creep in a long one (see `drift_watch`, which does the same with fixes).
"""

from __future__ import annotations

import cmath
import math
import statistics
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from agribot.core.facts import RowLineMoved

# Lines in a median: weeds taken for crop make single outliers.
LINES = 5
STEP_M = 0.1
WINDOWS_M = (0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
# Lines that must have fitted the pose before others are compared with them.
FITTED_LINES = 10
# Lines farther apart, in way or turn, are of two visits to a row.
MAX_GAP_M, MAX_TURN_RAD = 1.5, math.radians(20.0)
# On soil of preset `field` lines that are right reach 1.3 sigma; less than this is no harm.
ALARM_SIGMA, LEAST_M = 4.5, 0.1
# The line's own direction bears it out: a mount is turned by 1.5 degrees, and slopes push aside.
BORNE_OUT_SIGMA, OWN_COURSE_RAD = 2.0, math.radians(1.5)
# Patches of soil push a robot aside, and in turns wheels lose way, in m for each radian.
SOIL_RATIO, TURN_LOSS_M_PER_RAD = 0.01, 0.1
# Least duration of a move, s: leaves in the wind and drop-outs are shorter.
LASTS_S = 0.5
AGREE_RATIO = 0.5


class PosedLine(NamedTuple):
    """A row line at the pose of the filter when it came; vectors of the map are complex numbers.

    `off_m` is how far to the right of the pose, along the unit vector `right`, the line puts the
    robot, or the place `ahead_m` ahead of it. `left_m` is how far the body stands left of the row
    that it faces, `heading_rad` its direction against it. `course_rad` aligns wheels with the map,
    `course_std_rad` is its 1 sigma.
    """

    t_s: float
    row: int
    off_m: float
    std_m: float
    left_m: float
    heading_rad: float
    heading_std_rad: float
    ahead_m: float
    place_m: complex
    yaw_rad: float
    right: complex
    slip_rad: float
    lost_ratio: float
    course_std_rad: float


class _Point(NamedTuple):
    """A line, and what wheels and gyro have summed up until it came.

    `beside_m` is how far left of the row the body stands, less what the line's direction along the
    way makes of that: it stays the same while the line is right, whatever the course of the row.
    """

    line: PosedLine
    beside_m: float
    driven_m: complex
    odometry_rad: float
    way_m: float
    turned_rad: float


class Led(NamedTuple):
    """Shift of a line away from wheels and gyro, to the right of the rows, and 1 sigma."""

    off_m: float
    std_m: float


class RowLineWatch:
    """Call `move` with each step of the wheels, `add` with each line, `fit` where one fitted."""

    def __init__(self, walk_m_per_sqrt_m: float) -> None:
        self._walk_m2_per_m = walk_m_per_sqrt_m**2
        self._driven_m, self._odometry_rad = 0j, 0.0
        self._signed_m = self._way_m = self._turned_rad = 0.0
        self._own_m = self._own_signed_m = 0.0
        self._last: deque[_Point] = deque(maxlen=LINES)
        self._points: deque[_Point] = deque()
        self._fitted = 0
        self._since_s: float | None = None
        self._doubt: Led | None = None
        self.led: Led | None = None  # once it is known that lines moved

    def move(self, distance_m: float, odometry_rad: float, turn_rad: float) -> None:
        """Take a step; `odometry_rad` is the heading that the gyro alone has summed up."""
        self._driven_m += cmath.rect(distance_m, odometry_rad - turn_rad / 2.0)
        self._odometry_rad = odometry_rad
        self._signed_m += distance_m
        self._way_m += abs(distance_m)
        self._turned_rad += abs(turn_rad)

    def fit(self) -> None:
        """Note that a line fitted the pose."""
        self._fitted += 1

    def forget(self) -> None:
        """Believe the camera anew: a person has decided, or another visit to a row begins."""
        self._last.clear()
        self._points.clear()
        self._fitted = 0
        self._clear()

    def _clear(self) -> None:
        self._since_s = self._doubt = self.led = None

    @property
    def is_doubted(self) -> bool:
        """Whether lines have moved aside, long enough to be known or not."""
        return self._doubt is not None

    @property
    def fault(self) -> RowLineMoved | None:
        return None if self.led is None else RowLineMoved(abs(self.led.off_m))

    def add(self, line: PosedLine) -> None:
        """Hold a line against those before it."""
        if self._last and self._is_other_visit(self._last[-1], line):
            self.forget()
        self._own_m += math.sin(line.heading_rad) * (self._signed_m - self._own_signed_m)
        self._own_signed_m = self._signed_m
        self._last.append(
            _Point(line, line.left_m - self._own_m, self._driven_m, self._odometry_rad,
                   self._way_m, self._turned_rad)
        )  # fmt: skip
        if len(self._last) == LINES:
            self._judge(_take_median(self._last))

    def _is_other_visit(self, last: _Point, line: PosedLine) -> bool:
        turn_rad = math.remainder(self._odometry_rad - last.odometry_rad, math.tau)
        is_far = self._way_m - last.way_m > MAX_GAP_M or abs(turn_rad) > MAX_TURN_RAD
        return is_far or line.row != last.line.row

    def _judge(self, now: _Point) -> None:
        led = self._find_move(now)
        if led is None:
            self._clear()
            self._keep(now)
            return
        if self._doubt is None or abs(led.off_m) > abs(self._doubt.off_m):
            self._doubt = led
        self._since_s = now.line.t_s if self._since_s is None else self._since_s
        if now.line.t_s - self._since_s >= LASTS_S:
            self.led = self._doubt

    def _keep(self, now: _Point) -> None:
        """Hold later lines against this one, too, once lines are known to fit."""
        if self._fitted < FITTED_LINES:
            return
        if not self._points or now.way_m - self._points[-1].way_m >= STEP_M:
            self._points.append(now)
        while now.way_m - self._points[0].way_m > WINDOWS_M[-1] + STEP_M:
            self._points.popleft()

    def _find_move(self, now: _Point) -> Led | None:
        """Find the shortest window in which the line moved aside by itself.

        A line that is doubted is held against the same places until it is back at them by half.
        """
        points = list(self._points)
        part = AGREE_RATIO if self.is_doubted else 1.0
        index = len(points) - 1
        for window_m in WINDOWS_M:
            while index >= 0 and now.way_m - points[index].way_m < window_m - STEP_M / 2.0:
                index -= 1
            if index < 0:
                return None
            led = self._compare(points[index], now)
            if abs(led.off_m) > part * max(ALARM_SIGMA * led.std_m, LEAST_M) and _bears_out(
                points[index], now, part
            ):
                return led
        return None

    def _compare(self, then: _Point, now: _Point) -> Led:
        """Hold the line's move across the row against that of wheels and gyro."""
        before, here = then.line, now.line
        align_rad = before.yaw_rad - then.odometry_rad
        way_m = now.way_m - then.way_m
        driven_m = (
            (1.0 - before.lost_ratio)
            * cmath.rect(1.0, align_rad + before.slip_rad)
            * (now.driven_m - then.driven_m)
        )
        ahead_m = cmath.rect(here.ahead_m, now.odometry_rad + align_rad) - cmath.rect(
            before.ahead_m, before.yaw_rad
        )
        seen_m = here.place_m + cmath.rect(here.ahead_m, here.yaw_rad)
        seen_m -= before.place_m + cmath.rect(before.ahead_m, before.yaw_rad)
        apart_m = seen_m - driven_m - ahead_m
        off_m = (apart_m * here.right.conjugate()).real + here.off_m - before.off_m
        turned_m = TURN_LOSS_M_PER_RAD * (now.turned_rad - then.turned_rad)
        course_m = math.hypot(before.course_std_rad, SOIL_RATIO) * way_m
        variance_m2 = before.std_m**2 + here.std_m**2 + self._walk_m2_per_m * way_m
        return Led(off_m, math.sqrt(variance_m2 + course_m**2 + turned_m**2))


def _bears_out(then: _Point, now: _Point, part: float) -> bool:
    """Whether the line's own direction does not explain its move, as it does in a bent row."""
    before, here = then.line, now.line
    off_m = abs(now.beside_m - then.beside_m)
    seen_m2 = sum(
        line.std_m**2 + (line.ahead_m * line.heading_std_rad) ** 2 / LINES
        for line in (before, here)
    )
    course_m = OWN_COURSE_RAD * (now.way_m - then.way_m)
    return off_m > part * BORNE_OUT_SIGMA * math.sqrt(seen_m2 + course_m**2)


def _take_median(points: Sequence[_Point]) -> _Point:
    """Take the middle one of some points, with the medians of where their lines lie."""
    middle = points[len(points) // 2]
    off_m = statistics.median(point.line.off_m for point in points)
    beside_m = statistics.median(point.beside_m for point in points)
    return middle._replace(line=middle.line._replace(off_m=off_m), beside_m=beside_m)
