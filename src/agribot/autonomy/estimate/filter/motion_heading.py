"""The heading from motion: what the receiver saw of a way, laid over what wheels and gyro drew."""

from __future__ import annotations

import cmath
import math
from collections import deque
from typing import NamedTuple

import numpy as np

from agribot.core.messages import ComplexArray, FloatArray

# Shortest way between two places that the fit keeps.
PLACE_STEP_M = 0.05
# Places at which the fit drops every second one, so that it stays cheap on a long wait.
MOST_PLACES = 80
LEAST_PLACES = 6
# Least way of the antenna; shorter ones show how the robot settles, not where it goes.
LEAST_EXTENT_M = 0.5
# Largest difference of two pictures of one way in size, as a share.
SIZE_RATIO = 0.5
# Least speed that has a course, and least 1 sigma of a receiver's velocity.
LEAST_COURSE_MPS, LEAST_COURSE_STD_MPS = 0.1, 0.03
# Time over which receivers filter their velocities.
COURSE_MEMORY_S = 1.0
# A place that the wheels cannot have led to from most of the others, in joint sigmas.
OUTLIER_SIGMA = 4.0
# Largest loss or gain of the wheels' way on soil.
WAY_SLACK_RATIO = 0.2
# 1 sigma of the angle between where a skidding robot points and where it goes.
CRAB_STD_RAD = 0.03
# 1 sigma of a gyro's bias that no standstill has measured yet.
GYRO_BIAS_STD_RADPS = 0.003


class WayPlace(NamedTuple):
    """A fix's place of the antenna, east and north as one complex number, and that by the wheels.

    `white_m` is the scatter of the fix, `slow_m` and `walk_m_per_sqrt_s` size and walk of its
    slow error, all 1 sigma per axis; `way_m` is how far the wheels have turned in all.
    """

    t_s: float
    seen_m: complex
    led_m: complex
    way_m: float
    white_m: float
    slow_m: float
    walk_m_per_sqrt_s: float


class Course(NamedTuple):
    """The velocity of the antenna as a fix has it and as wheels and gyro have it, with 1 sigma."""

    t_s: float
    seen_mps: complex
    led_mps: complex
    std_mps: float


class Turn(NamedTuple):
    """The angle from the frame of the odometry to the map, with its 1 sigma."""

    rad: float
    std_rad: float


class MotionHeading:
    """Fits the turn between two pictures of one way.

    Errors of neighbouring fixes are not independent, so that the fit weighs them by their full
    covariance: a receiver that wanders says less about a heading than its many fixes suggest. What
    the residuals show beyond that widens the result.
    """

    def __init__(self) -> None:
        self._places: list[WayPlace] = []

    def add(self, place: WayPlace) -> None:
        """Take the place of a fix, if the robot has moved since the last one."""
        if self._places and abs(place.led_m - self._places[-1].led_m) < PLACE_STEP_M:
            return
        self._places.append(place)
        if len(self._places) > MOST_PLACES:
            del self._places[1::2]

    @property
    def extent_m(self) -> float:
        """Largest distance from the first place to another one."""
        first_m = self._places[0].led_m if self._places else 0j
        return max((abs(place.led_m - first_m) for place in self._places), default=0.0)

    def fit(self) -> Turn | None:
        """Fit the turn; None where way and fixes are too short or do not look alike."""
        places = _drop_outliers(self._places)
        if len(places) < LEAST_PLACES or self.extent_m < LEAST_EXTENT_M:
            return None
        whitener = np.linalg.inv(np.linalg.cholesky(_covariance_m2(places)))
        level = whitener @ np.ones(len(places))
        seen = _center(whitener @ [place.seen_m for place in places], level)
        led = _center(whitener @ [place.led_m for place in places], level)
        turned = _turn(seen, led)
        if turned is None:
            return None
        drift_rad = GYRO_BIAS_STD_RADPS * (places[-1].t_s - places[0].t_s) / 2.0
        return Turn(turned.rad, math.hypot(turned.std_rad, CRAB_STD_RAD, drift_rad))


class CourseHeading:
    """Fits the turn between the courses over ground and where wheels and gyro say that it goes."""

    def __init__(self) -> None:
        self._courses: deque[Course] = deque(maxlen=MOST_PLACES)

    def add(self, course: Course) -> None:
        """Take the velocity of a fix, if the robot drives fast enough to have a course."""
        if abs(course.led_mps) >= LEAST_COURSE_MPS:
            self._courses.append(course)

    def fit(self) -> Turn | None:
        """Fit the turn; None where the velocities are too few or do not look alike."""
        courses = self._courses
        if len(courses) < LEAST_PLACES:
            return None
        std_mps = np.array([max(course.std_mps, LEAST_COURSE_STD_MPS) for course in courses])
        seen = np.array([course.seen_mps for course in courses]) / std_mps
        led = np.array([course.led_mps for course in courses]) / std_mps
        turned = _turn(seen, led)
        if turned is None:
            return None
        step_s = (courses[-1].t_s - courses[0].t_s) / (len(courses) - 1)
        repeats = max(1.0, COURSE_MEMORY_S / max(step_s, 1e-3))
        return Turn(turned.rad, math.hypot(turned.std_rad * math.sqrt(repeats), CRAB_STD_RAD))


def _turn(seen: ComplexArray, led: ComplexArray) -> Turn | None:
    """Turn one picture onto the other, both of unit noise; None where their sizes differ."""
    information = float(np.vdot(led, led).real)
    product = complex(np.vdot(led, seen))
    left = seen - cmath.rect(1.0, cmath.phase(product)) * led
    excess = float(np.vdot(left, left).real) / (2 * len(seen) - 3)
    std = math.sqrt(max(excess, 1.0) / information)
    is_alike = abs(abs(product) / information - 1.0) <= max(SIZE_RATIO, 3.0 * std)
    return Turn(cmath.phase(product), std) if is_alike else None


def _covariance_m2(places: list[WayPlace]) -> FloatArray:
    """Per axis, of the fixes' errors: white ones, and slow ones as a Gauss-Markov process."""
    t_s = np.array([place.t_s for place in places])
    slow_m = np.array([place.slow_m for place in places])
    walk = np.array([place.walk_m_per_sqrt_s for place in places])
    memory_s = float(np.median(2.0 * (slow_m / walk) ** 2))
    slow_m2 = np.outer(slow_m, slow_m) * np.exp(-np.abs(t_s[:, None] - t_s) / memory_s)
    covariance: FloatArray = slow_m2 + np.diag([place.white_m**2 for place in places])
    return covariance


def _center(values: ComplexArray, level: FloatArray) -> ComplexArray:
    """Take off what a shift of the whole picture explains."""
    return values - level * (level @ values) / (level @ level)


def _drop_outliers(places: list[WayPlace]) -> list[WayPlace]:
    """Drop places that lie farther from most others than the wheels can have led."""
    seen_m = np.array([place.seen_m for place in places])
    way_m = np.array([place.way_m for place in places])
    std_m = np.array([math.hypot(place.white_m, place.slow_m) for place in places])
    apart_m = np.abs(seen_m[:, None] - seen_m)
    bound_m = (1.0 + WAY_SLACK_RATIO) * np.abs(way_m[:, None] - way_m)
    bound_m = bound_m + OUTLIER_SIGMA * np.hypot(std_m[:, None], std_m)
    is_odd = np.mean(apart_m > bound_m, axis=1) > 0.5
    return [place for place, odd in zip(places, is_odd, strict=True) if not odd]
