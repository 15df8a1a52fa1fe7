"""Wheel radius and effective separation from a calibration drive, by least squares.

The drive is a sequence of stretches with a rest before and after each. Along a straight leg the
wheels' mean turn times the radius is the distance; in a turn the difference of the sides times
radius / separation is the angle. GNSS or a tape measures the legs, the gyro the turns; the
directions of successive legs, seen by GNSS, check the gyro's scale.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.app.calibration.drive_log import DriveLog, Stretch
from agribot.core.errors import MissionError
from agribot.core.facts import DriveUndetermined, LegStood, WheelsStoodInTurns
from agribot.core.geo import wrap_rad
from agribot.core.messages import FloatArray, SensorBatch

# Error of the gyro's scale by its data sheet; directions of legs narrow it.
GYRO_SCALE_STD = 0.01
# Spread of the separation of a skidding vehicle: straight, in arcs and on the spot it differs.
SKID_STD_RATIO = 0.01
TAPE_STD_M = 0.01
STOOD_M = 0.1  # a leg of some metres that was no longer than that
MIN_TURN_RAD = 0.5
MAX_COURSE_STD_RAD = 0.05
RESIDUAL_LIMIT_RATIO = 0.05
STD_LIMIT_RATIO = 0.02
PARAMETERS = 3  # radius, radius / separation, gyro scale


class Residual(msgspec.Struct, frozen=True, kw_only=True):
    """Error of one stretch against the fitted geometry, relative to its size."""

    name: str
    ratio: float


class DriveFit(msgspec.Struct, frozen=True, kw_only=True):
    """Fitted values with 1 sigma. `wheel_radius_m` is the rolling one, under load."""

    wheel_radius_m: float
    wheel_radius_std_m: float
    separation_m: float
    separation_std_m: float
    gyro_scale: float
    gyro_scale_std: float
    residuals: tuple[Residual, ...]

    def complaints(self) -> tuple[str, ...]:
        """Why the fit must not be used; empty when it is good."""
        worst = max(self.residuals, key=lambda residual: abs(residual.ratio))
        found = []
        if abs(worst.ratio) > RESIDUAL_LIMIT_RATIO:
            found.append(
                f"'{worst.name}' is off by {worst.ratio:+.1%}, more than "
                f"{RESIDUAL_LIMIT_RATIO:.0%}: look for slippery or sloping ground, "
                "a dead motor or encoder, or a failed gyro"
            )
        for what, value, std in (
            ("wheel radius", self.wheel_radius_m, self.wheel_radius_std_m),
            ("separation", self.separation_m, self.separation_std_m),
        ):
            if std > STD_LIMIT_RATIO * abs(value):
                found.append(
                    f"the {what} is known to {std / abs(value):.1%} only, worse than "
                    f"{STD_LIMIT_RATIO:.0%}: use a better receiver or measure the legs by tape"
                )
        return tuple(found)


class _Equations:
    """Rows of `matrix @ (radius, radius / separation, gyro scale) = value`, each over its sigma."""

    def __init__(self) -> None:
        self._rows: list[FloatArray] = []
        self._values: list[float] = []

    def add(self, row: Sequence[float], value: float, std: float) -> None:
        self._rows.append(np.array(row) / std)
        self._values.append(value / std)

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Best parameters and their covariance, widened where the rows contradict each other.

        Raises: MissionError: the rows do not determine all parameters.
        """
        matrix, values = np.array(self._rows), np.array(self._values)
        if np.linalg.matrix_rank(matrix) < PARAMETERS:
            raise MissionError(DriveUndetermined())
        solution = np.linalg.lstsq(matrix, values, rcond=None)[0]
        misfit = matrix @ solution - values
        excess = float(misfit @ misfit) / max(len(values) - PARAMETERS, 1)
        covariance = np.array(np.linalg.inv(matrix.T @ matrix) * max(1.0, excess), dtype=float)
        return solution, covariance


def fit_drive(batches: Sequence[SensorBatch], stretches: Sequence[Stretch]) -> DriveFit:
    """Fit the geometry to a drive; `stretches` are in the order they were driven.

    Raises: MissionError: a sensor was silent, or the drive does not determine the geometry.
    """
    log = DriveLog(batches, stretches)
    equations = _Equations()
    equations.add((0.0, 0.0, 1.0), 1.0, GYRO_SCALE_STD)
    for index, stretch in enumerate(stretches):
        mean_rad, difference_rad = log.rolled_rad(stretch.start_s, stretch.at_rest_s)
        turned_rad = log.turned_rad(stretch.start_s, stretch.at_rest_s)
        if abs(turned_rad) > MIN_TURN_RAD or not stretch.is_leg:
            std = SKID_STD_RATIO * max(abs(turned_rad), MIN_TURN_RAD)
            equations.add((0.0, -difference_rad, turned_rad), 0.0, std)
        lengths = _lengths(log, index, stretch) if stretch.is_leg else []
        _check_moved(stretch, lengths, abs(mean_rad))
        for length_m, std_m in lengths:
            equations.add((abs(mean_rad), 0.0, 0.0), length_m, std_m)
    for turned_rad, seen_rad, std in _course_changes(log, stretches):
        equations.add((0.0, 0.0, turned_rad), seen_rad, std)
    (radius_m, gain, scale), covariance = equations.solve()
    if not gain:
        raise MissionError(WheelsStoodInTurns())
    to_separation = np.array([1.0 / gain, -radius_m / gain**2, 0.0])
    sigma = np.sqrt(np.diag(covariance))
    return DriveFit(
        wheel_radius_m=float(radius_m),
        wheel_radius_std_m=float(sigma[0]),
        separation_m=float(radius_m / gain),
        separation_std_m=float(np.sqrt(to_separation @ covariance @ to_separation)),
        gyro_scale=float(scale),
        gyro_scale_std=float(sigma[2]),
        residuals=_residuals(log, stretches, float(radius_m), float(gain), float(scale)),
    )


def _lengths(log: DriveLog, index: int, stretch: Stretch) -> list[tuple[float, float]]:
    """All that is known of a leg's length, each with its 1 sigma."""
    if stretch.distance_m is not None:
        return [(stretch.distance_m, TAPE_STD_M)]
    found = []
    moved = log.displacement(index)
    if moved is not None:
        found.append((float(np.hypot(*moved[0])), moved[1]))
    by_velocity = log.integrate(stretch)
    return [*found, by_velocity] if by_velocity else found


def _check_moved(
    stretch: Stretch, lengths: Sequence[tuple[float, float]], rolled_rad: float
) -> None:
    """Refuse a leg in which the wheels turned and the robot stood.

    Raises: MissionError: the best measurement of the leg's length shows no motion.
    """
    if not lengths or rolled_rad <= MIN_TURN_RAD:
        return
    length_m, std_m = min(lengths, key=lambda known: known[1])
    if length_m <= min(std_m, STOOD_M):
        raise MissionError(LegStood(stretch.name, rolled_rad, length_m, std_m))


def _course_changes(
    log: DriveLog, stretches: Sequence[Stretch]
) -> list[tuple[float, float, float]]:
    """Between successive legs: turned by the gyro, by the legs' directions, 1 sigma; rad."""
    courses = []
    for index, stretch in enumerate(stretches):
        moved = log.displacement(index) if stretch.is_leg else None
        if moved is None or moved[1] > MAX_COURSE_STD_RAD * np.hypot(*moved[0]):
            continue
        east_m, north_m = moved[0].tolist()
        backwards = log.rolled_rad(stretch.start_s, stretch.at_rest_s)[0] < 0.0
        course = math.atan2(north_m, east_m) + (math.pi if backwards else 0.0)
        courses.append((stretch, course, moved[1] / math.hypot(east_m, north_m)))
    changes = []
    for (before, course, std), (after, next_course, next_std) in itertools.pairwise(courses):
        turned = log.turned_rad(
            (before.start_s + before.end_s) / 2.0, (after.start_s + after.end_s) / 2.0
        )
        seen = turned + wrap_rad(next_course - course - turned)
        changes.append((turned, seen, math.hypot(std, next_std)))
    return changes


def _residuals(
    log: DriveLog, stretches: Sequence[Stretch], radius_m: float, gain: float, scale: float
) -> tuple[Residual, ...]:
    found = []
    for index, stretch in enumerate(stretches):
        found += _wheel_residuals(log, stretch)
        mean_rad, difference_rad = log.rolled_rad(stretch.start_s, stretch.at_rest_s)
        if not stretch.is_leg:
            turned = scale * log.turned_rad(stretch.start_s, stretch.at_rest_s)
            ratio = gain * difference_rad / turned - 1.0 if turned else math.inf
            found.append(Residual(name=stretch.name, ratio=ratio))
            continue
        lengths = _lengths(log, index, stretch)
        if lengths:
            length_m, std_m = min(lengths, key=lambda known: known[1])
            ratio = radius_m * abs(mean_rad) / length_m - 1.0
            # The error of the measured length is not the wheels' fault.
            explained = min(abs(ratio), 2.0 * std_m / length_m)
            found.append(Residual(name=stretch.name, ratio=ratio - math.copysign(explained, ratio)))
    return tuple(found)


def _wheel_residuals(log: DriveLog, stretch: Stretch) -> list[Residual]:
    """Front and rear wheel of a side turn alike; a mean of both would hide a dead encoder."""
    right_r, left_r, right_f, left_f = log.wheels_rad(stretch.start_s, stretch.at_rest_s).tolist()
    found = []
    for side, front, rear in (("right", right_f, right_r), ("left", left_f, left_r)):
        most = max(abs(front), abs(rear))
        if most > MIN_TURN_RAD:
            name = f"{stretch.name}, front against rear {side}"
            found.append(Residual(name=name, ratio=(front - rear) / most))
    return found
