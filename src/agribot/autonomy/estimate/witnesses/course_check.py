"""The first heading of a sensor, held against the courses of the first drive."""

from __future__ import annotations

import math
from typing import Literal

from agribot.autonomy.estimate.filter.motion_heading import Course, CourseHeading
from agribot.core.facts import CourseOff
from agribot.core.geo import wrap_rad

# 1 sigma of a heading from courses that is good enough to judge by.
JUDGE_STD_RAD = math.radians(5.0)
# 1 sigma of an uncalibrated compass, which the filter corrects by itself while driving.
SENSOR_STD_RAD = math.radians(7.5)
# Largest difference of sensor and courses, in joint sigmas.
AGREE_SIGMA = 4.0
Source = Literal["compass", "second antenna"]
SOURCES: dict[str, Source] = {"compass": "compass", "second antenna": "second antenna"}


class CourseCheck:
    """Compares once: a sensor that agrees on the first metres is believed from there on.

    Headings and courses are those of the frame of the odometry, so that no correction of the filter
    hides the difference.
    """

    def __init__(self) -> None:
        self.fault: CourseOff | None = None
        self._courses = CourseHeading()
        self._frame_rad = 0.0
        self._source: Source | None = None
        self._has_courses = False

    def begin(self, frame_rad: float, source: str) -> None:
        """Judge a sensor by the turn from the frame of the odometry to the map that it shows."""
        self._frame_rad = frame_rad
        self._source = SOURCES.get(source)

    @property
    def is_due(self) -> bool:
        """Whether there is a sensor to judge."""
        return self._source is not None

    @property
    def is_under_way(self) -> bool:
        """Whether a sensor is being judged, so that its heading may still turn out wrong."""
        return self.is_due and self._has_courses

    def add(self, course: Course) -> None:
        """Take the velocity of a fix and that of wheels and gyro, in the frame of the odometry."""
        self._has_courses = True
        self._courses.add(course)
        turn = self._courses.fit()
        if turn is None or turn.std_rad > JUDGE_STD_RAD:
            return
        off_rad = wrap_rad(self._frame_rad - turn.rad)
        limit_rad = AGREE_SIGMA * math.hypot(SENSOR_STD_RAD, turn.std_rad)
        if self._source is not None and abs(off_rad) > limit_rad:
            self.fault = CourseOff(self._source, abs(off_rad), limit_rad)
        self._source = None
