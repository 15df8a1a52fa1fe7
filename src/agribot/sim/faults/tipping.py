"""A robot whose front is lifted, as by a bank that it climbs, or by people who tip it."""

from __future__ import annotations

import math

from agribot.core.arithmetic import clamp
from agribot.core.robot import GRAVITY_MPS2, RobotSpec
from agribot.sim.attitude import read_roll_pitch_yaw
from agribot.sim.faults.schedule import Fault
from agribot.sim.physics import Physics
from agribot.sim.state import ANGULAR

LIFTING_S = 2.0
# Stiffness over the robot's weight at half its wheelbase, and damping, of the lifting force.
STIFFNESS, DAMPING_RATIO = 10.0, 0.7


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
