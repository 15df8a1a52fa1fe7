"""What the robot is told to do."""

from __future__ import annotations

import msgspec


class DriveCommand(msgspec.Struct, frozen=True, kw_only=True):
    """Body twist; the platform turns it into wheel speeds."""

    v_mps: float = 0.0
    yaw_rate_radps: float = 0.0


class ImplementCommand(msgspec.Struct, frozen=True, kw_only=True):
    """State of each spray nozzle, from left to right; empty where there is no implement."""

    nozzles_open: tuple[bool, ...] = ()


class RobotCommand(msgspec.Struct, frozen=True, kw_only=True):
    """What a platform is to do from now on."""

    t_s: float
    drive: DriveCommand = DriveCommand()
    implement: ImplementCommand = ImplementCommand()


STOP = DriveCommand()
