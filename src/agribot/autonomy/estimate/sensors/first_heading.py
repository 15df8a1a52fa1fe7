"""The first heading of a run: of a compass, a marked start, two antennas, or the way driven."""

from __future__ import annotations

import math
from typing import Literal

from agribot.autonomy.estimate.filter.ekf import YAW, Ekf, Row
from agribot.autonomy.estimate.filter.motion_heading import (
    Course,
    CourseHeading,
    MotionHeading,
    Turn,
    WayPlace,
)
from agribot.autonomy.estimate.filter.start import StartMark
from agribot.autonomy.estimate.witnesses.course_check import CourseCheck
from agribot.core.facts import Fact, HeadingAwaited, HeadingUnknown
from agribot.core.geo import wrap_rad

# 1 sigma of a heading that is good enough to begin with; measurements go on to correct it.
FIRST_STD_RAD = math.radians(10.0)
# Factor on the sigma of a way that is not, where it contradicts a mark.
ROUGH_RATIO = 1.5
# Time that a compass of the robot's description has for its first samples.
COMPASS_PATIENCE_S = 3.0
# Largest difference of fixes and velocities on one heading, in joint sigmas.
AGREE_SIGMA = 4.0
# 1 sigma of the way driven with which it has the last word on a mark.
CHECK_STD_RAD = math.radians(5.0)
# Way after which a heading is known with any receiver in order.
DRIVE_M = 3.0
YAW_ROW: Row = ((YAW, 1.0),)

# The first measurements that the filter waits for.
Known = Literal["yaw", "position"]


class FirstHeading:
    """Waits for the first source that knows the heading, and begins with it.

    A compass is heard within a second where there is one. Without one, a marked start gives the
    heading at once, and so do two antennas; otherwise it follows from the first metres driven:
    the turn between what the receiver saw of them and what wheels and gyro drew. Wheels know
    whether the robot drives backwards. A mark that nothing else confirms is held against the
    first metres, too, and so is a compass or a second antenna.
    """

    def __init__(self, ekf: Ekf, start: StartMark, known: set[Known], *, has_compass: bool) -> None:
        self.misplaced: Fact | None = None  # why the robot cannot face as it is marked to
        self._ekf, self._start, self._known = ekf, start, known
        self._has_compass = has_compass
        self._motion, self._course = MotionHeading(), CourseHeading()
        self.check = CourseCheck()
        self._turn: Turn | None = None
        self._since_s = self._now_s = math.inf
        self._turned_rad = 0.0
        self._is_unconfirmed = False

    @property
    def is_known(self) -> bool:
        return "yaw" in self._known

    @property
    def wants_fixes(self) -> bool:
        """Whether the heading is not known, or only from a mark."""
        return not self.is_known or self._is_unconfirmed

    @property
    def is_compass_awaited(self) -> bool:
        """Whether the magnetometer still may begin, which knows the heading at standstill."""
        return self._has_compass and not self._now_s - self._since_s >= COMPASS_PATIENCE_S

    def wait(self, t_s: float, turned_rad: float) -> None:
        """Go on until `t_s` without a heading; `turned_rad` is the turn since the start."""
        self._now_s, self._since_s = t_s, min(self._since_s, t_s)
        self._turned_rad = turned_rad
        if self.is_compass_awaited:
            return
        # A gyro bias that is learnt at standstill must not turn the drawn way.
        self._ekf.reset(YAW, wrap_rad(turned_rad), math.pi**2)
        if self._start.yaw_map_rad is not None:
            self._set_as_marked(self._start.yaw_map_rad)
            self._known.add("yaw")
            self._is_unconfirmed = True
            self._motion, self._course = MotionHeading(), CourseHeading()

    def begin(self, yaw_rad: float, variance: float, source: str, row: Row = YAW_ROW) -> None:
        """Begin with a heading of now, in the map, and its variance.

        Where the start is marked, the mark sets the heading, and the source corrects it.
        """
        residual_rad, marked_rad = 0.0, self._start.yaw_map_rad
        if marked_rad is None:
            self._ekf.reset(YAW, wrap_rad(yaw_rad), math.pi**2)
        else:
            self._set_as_marked(marked_rad)
            residual_rad = wrap_rad(yaw_rad - self._ekf.x[YAW])
            of_source_rad2 = self._ekf.project(row)[1] - float(self._ekf.cov[YAW, YAW]) + variance
            self.misplaced = self._start.heading_fault(
                residual_rad, math.sqrt(of_source_rad2), source
            )
        self._ekf.update(row, residual_rad, variance)
        self._known.add("yaw")
        self.check.begin(wrap_rad(yaw_rad - self._turned_rad), source)

    def confirm(self, course: Course | None) -> None:
        """Hold the sensor that began against a velocity, in the frame of the odometry."""
        if course is not None and self.check.is_due:
            self.check.add(course)
            self.misplaced = self.misplaced or self.check.fault

    def _set_as_marked(self, yaw_map_rad: float) -> None:
        self._ekf.reset(YAW, wrap_rad(yaw_map_rad + self._turned_rad), self._start.yaw_std_rad**2)

    def add_fix(self, place: WayPlace, course: Course | None) -> complex | None:
        """Take a fix and how wheels and gyro led to it.

        Returns: the turn from the frame of the odometry to the map, once it is known.
        """
        self._motion.add(place)
        if course is not None:
            self._course.add(course)
        turn = self._turn = _join(self._motion.fit(), self._course.fit())
        if self.is_known:
            self._hold_against_mark(turn)
            return None
        if turn is None or turn.std_rad > FIRST_STD_RAD or self.is_compass_awaited:
            return None
        self.begin(turn.rad + self._turned_rad, turn.std_rad**2, "way driven")
        return complex(math.cos(turn.rad), math.sin(turn.rad))

    def _hold_against_mark(self, off: Turn | None) -> None:
        """Hold the mark against the way driven, which is in the axes of the map by now.

        Fixes that wander and step by metres may draw the first metres across the way, more often
        than their sigma says: what is too unsure to begin with must contradict the mark clearly.
        """
        if off is not None:
            doubt = 1.0 if off.std_rad <= FIRST_STD_RAD else ROUGH_RATIO
            self.misplaced = self._start.heading_fault(off.rad, doubt * off.std_rad, "way driven")
            self._is_unconfirmed = off.std_rad > CHECK_STD_RAD

    @property
    def reason(self) -> HeadingAwaited | HeadingUnknown:
        """Why the heading is not known."""
        if self.is_compass_awaited:
            return HeadingAwaited()
        std_rad = None if self._turn is None else self._turn.std_rad
        return HeadingUnknown(self._has_compass, DRIVE_M, self._motion.extent_m, std_rad)


def _join(of_places: Turn | None, of_courses: Turn | None) -> Turn | None:
    """Take the surer one of two; None where they contradict each other."""
    if of_places is None or of_courses is None:
        return of_places or of_courses
    std_rad = math.hypot(of_places.std_rad, of_courses.std_rad)
    if abs(wrap_rad(of_places.rad - of_courses.rad)) > AGREE_SIGMA * std_rad:
        return None
    return min(of_places, of_courses, key=lambda turn: turn.std_rad)
