"""Faults of the robot's body and of the ground: motors, mud, a push, a pole in the way."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from agribot.core.messages import STOP, WHEEL_NAMES, DriveCommand
from agribot.core.robot import Origin, RobotSpec, Shape
from agribot.core.world import Obstacle, WorldSpec
from agribot.sim.faults.handling import Carrying, Tipping
from agribot.sim.faults.motors import draw_weak_wheel, list_torque_shares
from agribot.sim.faults.schedule import Fault
from agribot.sim.physics import Physics

MUD_RADIUS_M = 2.0  # radius of the hollow around the place where the mud begins
POLE_AHEAD_M, POLE_RADIUS_M, POLE_HEIGHT_M = 2.0, 0.05, 1.2


class BodyFaults:
    """All faults that act in the physics; call `step` before each advance."""

    def __init__(self, faults: Sequence[Fault], robot: RobotSpec, seed: int) -> None:
        drive = robot.drive
        self._faults, self._drive = tuple(faults), drive
        self._weak_wheel = draw_weak_wheel(seed)
        self._limits_nm = dict.fromkeys(WHEEL_NAMES, drive.wheel_torque_nm)
        self._friction_ratio = 1.0
        self._carryings = {
            number: Carrying(fault)
            for number, fault in enumerate(self._faults)
            if fault.name == "carried"
        }
        self._tippings = [Tipping(f, robot) for f in self._faults if f.name == "robot.tipped"]
        self._placed: set[int] = set()
        self._hollows_map_m: dict[int, tuple[float, float]] = {}

    def step(self, t_s: float, physics: Physics) -> Obstacle | None:
        """Let the faults at a time act; return an obstacle that has appeared, or None."""
        on = [fault for fault in self._faults if fault.is_on(t_s)]
        self._limit_torques(on, t_s, physics)
        ratio = self._find_friction_ratio(t_s, physics)
        if ratio != self._friction_ratio:
            self._friction_ratio = ratio
            physics.set_mud(ratio)
        if any(fault.name == "motor.runaway" for fault in on):
            physics.command(DriveCommand(v_mps=self._drive.max_speed_mps))
        if any(fault.name == "button.pressed" for fault in on):
            physics.command(STOP)
        for tipping in self._tippings:
            tipping.step(t_s, physics)
        found = None
        for number, fault in enumerate(self._faults):
            if not fault.is_on(t_s):
                continue
            if fault.name == "carried":
                self._carryings[number].step(t_s, physics)
            if fault.name == "obstacle.unmapped" and number not in self._placed:
                self._placed.add(number)
                found = make_pole(*physics.find_place_map_m(POLE_AHEAD_M))
                physics.add_obstacle(found)
        return found

    def hears(self, t_s: float) -> bool:
        """Whether the board hears commands."""
        deaf = ("board.silent", "motor.runaway", "button.pressed")
        return not any(fault.name in deaf and fault.is_on(t_s) for fault in self._faults)

    def _find_friction_ratio(self, t_s: float, physics: Physics) -> float:
        """Find what share of its friction the ground has where the robot is; 1 out of all mud."""
        ratio = 1.0
        for number, fault in enumerate(self._faults):
            if fault.name != "soil.mud" or not fault.is_on(t_s):
                continue
            x_map_m, y_map_m, _ = physics.find_place_map_m(0.0)
            middle_map_m = self._hollows_map_m.setdefault(number, (x_map_m, y_map_m))
            if math.dist(middle_map_m, (x_map_m, y_map_m)) < MUD_RADIUS_M:
                ratio *= fault.find_number(t_s)
        return ratio

    def _limit_torques(self, on: Sequence[Fault], t_s: float, physics: Physics) -> None:
        shares = list_torque_shares(on, t_s, self._weak_wheel)
        most_nm = self._drive.wheel_torque_nm
        limits_nm = {wheel: share * most_nm for wheel, share in shares.items()}
        for wheel, limit_nm in limits_nm.items():
            if limit_nm != self._limits_nm[wheel]:
                physics.limit_torque(wheel, limit_nm)
        self._limits_nm = limits_nm


def make_pole(x_map_m: float, y_map_m: float, ground_m: float) -> Obstacle:
    """Make the pole that no map knows."""
    standing = Origin(xyz_m=(0.0, 0.0, POLE_HEIGHT_M / 2.0))
    shape = Shape(
        kind="cylinder", size_m=(POLE_RADIUS_M, POLE_HEIGHT_M, 0.0), origin=standing,
        rgba=(0.45, 0.32, 0.2, 1.0),
    )  # fmt: skip
    return Obstacle(
        name="unmapped pole", kind="pole", x_map_m=x_map_m, y_map_m=y_map_m, z_map_m=ground_m,
        yaw_rad=0.0, shapes=(shape,),
    )  # fmt: skip


def move_start(world: WorldSpec, faults: Sequence[Fault]) -> WorldSpec:
    """Put the robot down beside its start, or turned, as the faults at the start say."""
    (x_m, y_m), yaw_rad = world.spawn_xy_map_m, world.spawn_yaw_map_rad
    for fault in faults:
        if fault.name == "start.aside":
            x_m -= fault.number * math.sin(yaw_rad)
            y_m += fault.number * math.cos(yaw_rad)
    turned_rad = sum(math.radians(f.number) for f in faults if f.name == "start.turned")
    return msgspec.structs.replace(
        world, spawn_xy_map_m=(x_m, y_m), spawn_yaw_map_rad=yaw_rad + turned_rad
    )
