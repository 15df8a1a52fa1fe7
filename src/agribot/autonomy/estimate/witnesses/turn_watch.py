"""Gyro, compass and wheels compared: which of them reports another turn than the others.

Over windows of some seconds each measures the robot's turn. A step of the gyro's bias shows
against wheels and compass alike, a magnet that comes near the compass against gyro and wheels.
The one that two others outvote is named (parity of three, as in `integrity`).
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from typing import NamedTuple

from agribot.core.facts import CompassTurned, GyroTurns
from agribot.core.geo import wrap_rad

WINDOWS_S = (1.0, 2.0, 4.0)
STEP_S = 0.1
# Error of the wheels' turn on soil, 1 sigma: as a share, as a rate that lasts, and as one that
# wanders. Measured on tilled and sloping ground.
GAIN_RATIO, DRAG_RADPS, DRAG_RAD_PER_SQRT_S = 0.15, 0.01, 0.01
GYRO_SIGMAS, COMPASS_SIGMAS = 4.0, 5.0
# Samples in each of the two medians whose difference is a compass turn.
MEDIAN_OF, MEDIAN_FACTOR = 5, math.pi / 2.0
# Turns off which the compass's iron says something else, and a wander in place over two minutes.
IRON_MEMORY_S = 120.0
NAMED_S = 15.0


class _Turned(NamedTuple):
    """Turns until now.

    By gyro and by wheels, those of the wheels and the larger of both without their signs, and the
    compass's beyond the gyro's.
    """

    t_s: float
    gyro_rad: float
    wheels_rad: float
    by_wheels_rad: float
    all_rad: float
    compass_rad: float | None


class GyroFault(NamedTuple):
    """Error of the gyro's rate, its 1 sigma, since when, and how far that has led it off."""

    bias_radps: float
    std_radps: float
    turned_rad: float
    since_s: float


class TurnWatch:
    """Call `move` with every step, `add_compass` with the compass less the gyro."""

    def __init__(self, iron_std_rad: float) -> None:
        self._iron_std_rad = iron_std_rad
        self._turns: deque[_Turned] = deque()
        self._gyro_rad = self._wheels_rad = self._by_wheels_rad = self._all_rad = 0.0
        self._compass: deque[float] = deque(maxlen=MEDIAN_OF)
        self._compass_var = 0.0
        self._gyro: GyroTurns | None = None
        self._turned: CompassTurned | None = None
        self._gyro_s = self._compass_s = -math.inf

    def add_compass(self, beside_rad: float, variance_rad2: float) -> None:
        """Take the heading of a compass less what the gyro summed up; only changes count."""
        if self._compass:
            last_rad = self._compass[-1]
            beside_rad = last_rad + wrap_rad(beside_rad - last_rad)
        self._compass.append(beside_rad)
        self._compass_var = MEDIAN_FACTOR * variance_rad2 / MEDIAN_OF

    def restart(self) -> None:
        """Compare with nothing of before."""
        self._turns.clear()
        self._compass.clear()

    def move(self, t_s: float, gyro_rad: float, wheel_turn_rad: float) -> GyroFault | None:
        """Take a step: the gyro's turn until now, and that of the wheels in the step."""
        self._wheels_rad += wheel_turn_rad
        self._by_wheels_rad += abs(wheel_turn_rad)
        self._all_rad += max(abs(wheel_turn_rad), abs(gyro_rad - self._gyro_rad))
        self._gyro_rad = gyro_rad
        if self._turns and t_s - self._turns[-1].t_s < STEP_S - 1e-6:
            return None
        compass_rad = statistics.median(self._compass) if self._compass else None
        here = _Turned(
            t_s, gyro_rad, self._wheels_rad, self._by_wheels_rad, self._all_rad, compass_rad
        )
        fault = self._compare(here)
        self._turns.append(here)
        while t_s - self._turns[0].t_s > WINDOWS_S[-1] + STEP_S:
            self._turns.popleft()
        if fault is not None:
            self._turns.clear()
        return fault

    def gyro_fault(self, t_s: float) -> GyroTurns | None:
        return self._gyro if t_s - self._gyro_s <= NAMED_S else None

    def compass_fault(self, t_s: float) -> CompassTurned | None:
        return self._turned if t_s - self._compass_s <= NAMED_S else None

    def _compare(self, here: _Turned) -> GyroFault | None:
        index = len(self._turns) - 1
        for window_s in WINDOWS_S:
            while index >= 0 and here.t_s - self._turns[index].t_s < window_s - STEP_S / 2.0:
                index -= 1
            if index < 0:
                return None
            then = self._turns[index]
            if then.compass_rad is not None and here.compass_rad is not None:
                fault = self._vote(then, here, here.compass_rad - then.compass_rad)
                if fault is not None:
                    return fault
        return None

    def _vote(self, then: _Turned, here: _Turned, compass_rad: float) -> GyroFault | None:
        """Find who differs from both others; `compass_rad` is its turn beyond the gyro's."""
        lasted_s = here.t_s - then.t_s
        gyro_rad = here.gyro_rad - then.gyro_rad
        wheels_rad = here.wheels_rad - then.wheels_rad - gyro_rad
        by_wheels_rad = here.by_wheels_rad - then.by_wheels_rad
        # The medians look back beyond the window.
        turned_rad = here.all_rad - self._turns[0].all_rad
        drag_rad2 = (DRAG_RADPS * lasted_s) ** 2 + DRAG_RAD_PER_SQRT_S**2 * lasted_s
        wheels_rad2 = (GAIN_RATIO * by_wheels_rad) ** 2 + drag_rad2
        iron_rad2 = self._iron_std_rad**2 * (turned_rad**2 + 2.0 * lasted_s / IRON_MEMORY_S)
        compass_rad2 = 2.0 * self._compass_var + iron_rad2
        if wheels_rad**2 > GYRO_SIGMAS**2 * wheels_rad2:
            if compass_rad**2 > 4.0 * compass_rad2 and _is_nearer(compass_rad, wheels_rad):
                return self._name_gyro(here.t_s, -wheels_rad, math.sqrt(wheels_rad2), lasted_s)
        elif compass_rad**2 > COMPASS_SIGMAS**2 * compass_rad2:
            self._name_compass(here.t_s, compass_rad)
        return None

    def _name_gyro(self, t_s: float, by_rad: float, std_rad: float, lasted_s: float) -> GyroFault:
        self._gyro_s = t_s
        self._gyro = GyroTurns(by_rad / lasted_s)
        return GyroFault(by_rad / lasted_s, std_rad / lasted_s, by_rad, t_s - lasted_s)

    def _name_compass(self, t_s: float, by_rad: float) -> None:
        if t_s - self._compass_s > NAMED_S:
            self._turned = CompassTurned(by_rad)
        self._compass_s = t_s


def _is_nearer(compass_rad: float, wheels_rad: float) -> bool:
    """Whether the compass sides with the wheels rather than with the gyro."""
    return abs(compass_rad - wheels_rad) < abs(compass_rad)
