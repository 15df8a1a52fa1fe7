"""What every implement states: where on the robot it works, and what it can do."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import msgspec

from agribot.core.config import Count, NonNegative, Positive
from agribot.core.messages import ImplementCommand


class StateLine(NamedTuple):
    """State of an implement in its own words: "Nozzles", "●○○"."""

    name: str
    text: str


class ImplementSpec(msgspec.Struct, frozen=True, kw_only=True):
    """Sections side by side across the robot, each working or not.

    Their middles stand `section_spacing_m` apart at `x_body_m`, the tool point, and each works a
    strip of `section_width_m`. A command takes effect `latency_s` after it was given. The fields of
    a kind are the tags of its block in the robot's description, `<agribot><KIND>`.
    """

    kind: ClassVar[str]
    sections: ClassVar[str] = "sections"  # the word for them
    verb: ClassVar[str] = "treated"  # the treatment of a weed, as a past participle
    min_speed_mps: ClassVar[float] = 0.0  # slower than this, it may not work
    works_backwards: ClassVar[bool] = True
    wets_ground: ClassVar[bool] = False
    cuts_plants: ClassVar[bool] = False  # takes them out of the ground: they fall at once

    x_body_m: float
    section_count: Count
    section_spacing_m: Positive
    section_width_m: Positive
    latency_s: NonNegative

    @property
    def width_m(self) -> float:
        """Working width: what a field is planned for."""
        return self.section_count * self.section_spacing_m

    def section_y_body_m(self) -> tuple[float, ...]:
        """Lateral position of each section, from left to right."""
        first_m = (self.section_count - 1) / 2.0 * self.section_spacing_m
        return tuple(first_m - i * self.section_spacing_m for i in range(self.section_count))

    def describe(self, command: ImplementCommand) -> tuple[StateLine, ...]:
        """Describe a command in lines for a person to read."""
        return _describe_sections(self.sections, command)


def describe_command(
    spec: ImplementSpec | None, command: ImplementCommand
) -> tuple[StateLine, ...]:
    """Describe a command in the words of its implement, in plain ones if that is unknown."""
    return _describe_sections("implement", command) if spec is None else spec.describe(command)


def _describe_sections(name: str, command: ImplementCommand) -> tuple[StateLine, ...]:
    marks = "".join("●" if is_on else "○" for is_on in command.sections_on)
    return (StateLine(name.capitalize(), marks),) if marks else ()
