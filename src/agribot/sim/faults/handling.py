"""A robot in people's hands: its front is lifted, or it is carried aside and set down again.

A bank that it climbs lifts its front, too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agribot.core.arithmetic import clamp
from agribot.core.messages import FloatArray
from agribot.core.robot import GRAVITY_MPS2, RobotSpec
from agribot.sim.attitude import read_roll_pitch_yaw
from agribot.sim.faults.schedule import Fault
from agribot.sim.physics import Physics
from agribot.sim.state import ANGULAR

LIFTING_S = 2.0
# Stiffness over the robot's weight at half its wheelbase, and damping, of the lifting force.
STIFFNESS, DAMPING_RATIO = 10.0, 0.7
LIFT_M = 0.1
# Shares of the whole time: up to here it only rises, from here on it only sinks.
UP, DOWN = 0.3, 0.7


class Tipping:
    """Turns the robot about its width; call `step` in every tick of the fault."""

    def __init__(self, fault: Fault, robot: RobotSpec) -> None:
        self._fault = fault
        arm_m = robot.drive.wheelbase_m / 2.0
        self._stiffness_nmprad = STIFFNESS * robot.mass_kg * GRAVITY_MPS2 * arm_m
        inertia_kgm2 = robot.mass_kg * arm_m**2  # about the wheels that stay down
        self._damping_nmspr = 2.0 * DAMPING_RATIO * math.sqrt(self._stiffness_nmprad * inertia_kgm2)
        self._from_rad: float | None = None

    def step(self, t_s: float, physics: Physics) -> None:
        """Lift on, hold, or let go once the fault is over."""
        row = physics.history[-1]
        nose_rad = -read_roll_pitch_yaw(row)[1]
        if not self._fault.is_on(t_s):
            if self._from_rad is not None:
                physics.twist(0.0)
                self._from_rad = None
            return
        if self._from_rad is None:
            self._from_rad = nose_rad
        share = clamp((t_s - self._fault.begin_s) / LIFTING_S, 0.0, 1.0)
        aim_rad = self._from_rad + share * (math.radians(self._fault.number) - self._from_rad)
        physics.twist(
            self._stiffness_nmprad * (aim_rad - nose_rad)
            + self._damping_nmspr * float(row[ANGULAR][1])
        )


class LineMotion(NamedTuple):
    """A place along a line, its speed and its acceleration, 0 at both ends."""

    way: float
    speed: float
    acceleration: float


class Carrying:
    """Holds the robot in the air, level as it stood; call `step` in every tick of the fault."""

    def __init__(self, fault: Fault) -> None:
        self._aside_m, self._begin_s = fault.number, fault.begin_s
        self._duration_s = (fault.handled_until_s or fault.begin_s) - fault.begin_s
        self._from: FloatArray | None = None  # position and left, (2, 3)
        self._rise_m = 0.0
        self._is_over = False

    def step(self, t_s: float, physics: Physics) -> None:
        """Hold the robot where hands have it at a time, and let go at the end."""
        if self._is_over:
            return
        if self._from is None:
            self._from = physics.find_place_and_left()
            there = self._from[0] + self._aside_m * self._from[1]
            self._rise_m = physics.find_rise_m(self._from[0], there)
        share = (t_s - self._begin_s) / self._duration_s
        physics.hold(*self._find_motion(min(share, 1.0)))
        if share >= 1.0:
            self._is_over = True
            physics.let_go()

    def _find_motion(self, share: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position, velocity and acceleration in the map, (3,) each."""
        assert self._from is not None
        place, left = self._from
        up = np.array([0.0, 0.0, 1.0])
        aside, level = _move(share, UP / 2.0, 1.0 - UP / 2.0), _move(share, UP, DOWN)
        rise, sink = _move(share, 0.0, UP), _move(share, DOWN, 1.0)
        way, speed, acceleration = (
            self._aside_m * a * left + (self._rise_m * b + LIFT_M * (c - d)) * up
            for a, b, c, d in zip(aside, level, rise, sink, strict=True)
        )
        return place + way, speed / self._duration_s, acceleration / self._duration_s**2


def _move(share: float, first: float, last: float) -> LineMotion:
    """Go from 0 to 1 between two shares of the time, along a cycloid."""
    span = last - first
    u = min(max((share - first) / span, 0.0), 1.0)
    turn = 2.0 * math.pi * u
    return LineMotion(
        u - math.sin(turn) / (2.0 * math.pi),
        (1.0 - math.cos(turn)) / span,
        2.0 * math.pi * math.sin(turn) / span**2,
    )
