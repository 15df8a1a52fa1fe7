"""The hoe: a bar of blades, each lowered into the soil or lifted over it."""

from __future__ import annotations

from typing import ClassVar

from agribot.core.config import Positive
from agribot.core.implement.spec import ImplementSpec, StateLine
from agribot.core.messages import ImplementCommand

DEPTH = "depth_m"  # the setpoint of a command


class HoeSpec(ImplementSpec, frozen=True, kw_only=True):
    """Blades across the robot that cut and lift what grows in their strips.

    A blade goes from `lift_m` above the ground down to its depth, at most `depth_m`, and back in
    `stroke_s` each way. The soil holds it back with `draught_npm2` for each metre of its width and
    each metre of its depth.
    """

    kind: ClassVar[str] = "hoe"
    sections: ClassVar[str] = "blades"
    verb: ClassVar[str] = "hoed"
    min_speed_mps: ClassVar[float] = 0.1  # slower, a blade parts the soil and uproots nothing
    cuts_plants: ClassVar[bool] = True
    works_backwards: ClassVar[bool] = False  # its back would be pushed into the soil

    lift_m: Positive
    depth_m: Positive
    stroke_s: Positive
    draught_npm2: Positive

    def describe(self, command: ImplementCommand) -> tuple[StateLine, ...]:
        lines = super().describe(command)
        if command.is_on and DEPTH in command.setpoints:
            lines = (*lines, StateLine("depth", f"{100.0 * command.setpoints[DEPTH]:.1f} cm"))
        return lines
