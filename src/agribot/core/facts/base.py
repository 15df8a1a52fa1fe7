"""Structure of every fact, and those that are about anything."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import msgspec

Part = Literal["gnss", "compass", "imu", "wheels", "motors", "ground", "camera", "network",
               "bumper", "button", "contactor", "battery", "clock", "link", "disk", "start",
               "robot", "crop", "inputs", "program", "lidar"]  # fmt: skip
# note: nothing is wrong; warning: the robot goes on; fault: it must not, or not by itself.
Severity = Literal["note", "warning", "fault"]
Wheel = Literal["right_wheel_R", "left_wheel_R", "right_wheel_F", "left_wheel_F"]
Side = Literal["left", "right"]
Where = Literal["left", "right", "ahead", "behind"]
End = Literal["front", "behind"]  # ends of the robot
Unspoken = Literal["wheels", "imu", "gnss", "compass", "lidar"]  # a sensor that may fall silent
Motion = Literal["stand", "backwards", "fast", "slow"]  # motions of wheels, against their command
Check = Literal["board", "imu", "imu_cable", "cable", "gnss", "compass", "wheels", "lidar"]

# A sensor, a board, the program or the encoder of one wheel may be silent for moments.
ComingAndGoing = Literal["gnss", "compass", "imu", "wheels", "camera", "board", "contactor",
                         "program", "right_wheel_R", "left_wheel_R", "right_wheel_F",
                         "left_wheel_F"]  # fmt: skip

_CAPITAL = re.compile(r"(?<!^)(?=[A-Z])")


def _make_code(name: str) -> str:
    return _CAPITAL.sub("_", name).lower()


class Fact(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="code", tag=_make_code):
    """A finding; see the package."""

    about: ClassVar[tuple[Part, ...]] = ()
    severity: ClassVar[Severity] = "fault"

    @property
    def code(self) -> str:
        """Its stable name."""
        return str(self.__struct_config__.tag)

    @property
    def values(self) -> tuple[tuple[str, Any], ...]:
        """Its fields by name."""
        return tuple((name, getattr(self, name)) for name in self.__struct_fields__)

    @property
    def inner(self) -> tuple[Fact, ...]:
        """The facts that it holds."""
        found: list[Fact] = []
        for _, value in self.values:
            several = value if isinstance(value, tuple) else (value,)
            found += [one for one in several if isinstance(one, Fact)]
        return tuple(found)

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts at fault, those of the facts inside it included."""
        found: dict[str, None] = dict.fromkeys(self.about)
        for fact in self.inner:
            found.update(dict.fromkeys(fact.parts))
        return tuple(found)

    @property
    def kind(self) -> tuple[object, ...]:
        """The part that stays the same while only numbers change."""
        values = (_find_kind(value) for _, value in self.values)
        return (self.code, *(value for value in values if not _is_number(value)))

    @property
    def numbers(self) -> dict[str, float]:
        """Its finite numbers by name, and those of the facts inside it under names of their own.

        A field with several facts adds none: they have the same names.
        """
        found: dict[str, float] = {}
        for _, value in self.values:
            if isinstance(value, Fact):
                found.update(value.numbers)
        own = {name: value for name, value in self.values if _is_number(value)}
        found.update({name: float(value) for name, value in own.items() if math.isfinite(value)})
        return found

    @property
    def variant(self) -> str:
        """Name of the text that fits; empty where there is one."""
        return ""

    @property
    def causes(self) -> tuple[str, ...]:
        """The codes of the facts inside it, the nearest first."""
        return tuple(code for fact in self.inner for code in (fact.code, *fact.causes))

    @property
    def kinds(self) -> list[str]:
        """Its kind and those of the facts inside it as text, to be compared elsewhere."""
        return [str(self.kind), *(kind for fact in self.inner for kind in fact.kinds)]

    def holds(self, other: Fact) -> bool:
        """Whether it is the same but for numbers as another, or a fact inside it is."""
        return self.kind == other.kind or any(fact.holds(other) for fact in self.inner)


def _find_kind(value: object) -> object:
    if isinstance(value, tuple):
        return tuple(map(_find_kind, value))
    return value.kind if isinstance(value, Fact) else value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def find_kind(fact: Fact | None) -> tuple[object, ...]:
    """Return what stays the same of a fact while its numbers change; empty without a fact."""
    return () if fact is None else fact.kind


class Said(Fact, frozen=True):
    """Words of a person, a device or an error; `by` is who said it, where that matters."""

    text: str
    by: str = ""


class PluginFact(Fact, frozen=True):
    """A fact of an installed package, whose texts the package brings (group `agribot.facts`).

    `plugin` is the entry point's name, `name` the code there, `part` the part at fault: one of the
    robot's or the package's own. `amounts` are its numbers, by names with units.
    """

    plugin: str
    name: str
    part: str = ""
    amounts: dict[str, float] = msgspec.field(default_factory=dict)

    @property
    def code(self) -> str:
        return f"{self.plugin}.{self.name}"

    @property
    def parts(self) -> tuple[str, ...]:
        return (self.part,) if self.part else ()

    @property
    def kind(self) -> tuple[object, ...]:
        return (self.code, self.plugin, self.name, self.part)

    @property
    def numbers(self) -> dict[str, float]:
        return {name: value for name, value in self.amounts.items() if math.isfinite(value)}


if TYPE_CHECKING:
    AnyFact = Fact  # the union of all; the package puts it into each module


class Both(Fact, frozen=True):
    """One fact and then another."""

    first: AnyFact
    second: AnyFact


def join_facts(facts: Sequence[AnyFact]) -> AnyFact | None:
    """Make one fact of several, in their order; None of none."""
    joined: AnyFact | None = None
    for fact in reversed(facts):
        joined = fact if joined is None else Both(fact, joined)
    return joined
