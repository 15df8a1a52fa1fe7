"""The point tool: heads that each heat one small spot, aimed at one weed after the other."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

from agribot.core.config import NonNegative, Positive
from agribot.core.implement.spec import ImplementSpec
from agribot.core.messages import ImplementCommand


class PointSpec(ImplementSpec, frozen=True, kw_only=True):
    """Heads across the robot, each aiming into the strip below it.

    A head reaches `reach_m` before and behind the tool point. What is inside `spot_radius_m` of its
    aim for `dwell_s` dies. The aim moves over the ground with `aim_speed_mps` at most, and between
    two shots a head is dark for `recharge_s`.
    """

    kind: ClassVar[str] = "point"
    sections: ClassVar[str] = "heads"
    verb: ClassVar[str] = "burnt"

    reach_m: Positive
    spot_radius_m: Positive
    dwell_s: Positive
    aim_speed_mps: Positive
    recharge_s: NonNegative


class Aim(NamedTuple):
    """A place on the ground: ahead of the tool point, and to the left of the robot's middle."""

    x_m: float
    y_m: float


def name_aim(head: int) -> tuple[str, str]:
    """Name the two setpoints of a command that aim a head, counted from 0 on the left."""
    return f"aim_{head}_x_m", f"aim_{head}_y_m"


def read_aim(command: ImplementCommand, head: int) -> Aim | None:
    """Read where a command aims a head; None where it does not say."""
    x_m, y_m = (command.setpoints.get(name) for name in name_aim(head))
    return None if x_m is None or y_m is None else Aim(x_m, y_m)
