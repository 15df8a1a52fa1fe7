"""Commands to the robot's wheels and implement."""

from __future__ import annotations

import math

import msgspec


class DriveCommand(msgspec.Struct, frozen=True, kw_only=True):
    """Body twist; the platform turns it into wheel speeds."""

    v_mps: float = 0.0
    yaw_rate_radps: float = 0.0


class ImplementCommand(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Working sections of the implement, from left to right; none without an implement.

    `setpoints` are numbers that a kind of implement wants beside that, by names with their units,
    such as `depth_m`. They do nothing by themselves: an implement with all sections off is at rest.
    Recordings know the sections by the name of those of a sprayer.
    """

    sections_on: tuple[bool, ...] = msgspec.field(name="nozzles_open", default=())
    setpoints: dict[str, float] = {}

    @property
    def is_on(self) -> bool:
        """Whether any section works."""
        return any(self.sections_on)

    @property
    def is_finite(self) -> bool:
        return all(math.isfinite(value) for value in self.setpoints.values())

    def switch_off(self) -> ImplementCommand:
        """Return the command to the same implement that is always safe: nothing works."""
        return ImplementCommand(sections_on=(False,) * len(self.sections_on))


class RobotCommand(msgspec.Struct, frozen=True, kw_only=True):
    """Command to a platform from now on.

    `is_power_cut` opens the contactor in the motors' supply, where the robot has one.
    """

    t_s: float
    drive: DriveCommand = DriveCommand()
    implement: ImplementCommand = ImplementCommand()
    is_power_cut: bool = False


STOP = DriveCommand()
