"""Wheels, motors and the ground under them."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from agribot.core.facts.base import Fact, Motion, Part, Wheel

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact


class MotorsReportFault(Fact, frozen=True):
    """The board flags motors."""

    about: ClassVar[tuple[Part, ...]] = ("motors",)
    wheels: tuple[str, ...]

    @property
    def variant(self) -> str:
        return "one" if len(self.wheels) == 1 else "many"


class MotorDead(Fact, frozen=True):
    """A motor gives no torque while the others work."""

    about: ClassVar[tuple[Part, ...]] = ("motors",)
    wheel: Wheel


class WheelsWrong(Fact, frozen=True):
    """Wheels do not follow their command."""

    about: ClassVar[tuple[Part, ...]] = ("wheels",)
    wheels: tuple[Wheel, ...]
    motion: Motion
    speed_radps: float
    wanted_radps: float

    @property
    def variant(self) -> str:
        return f"{self.motion}_{ {1: 'one', 4: 'all'}.get(len(self.wheels), 'many') }"


class WheelsSwapped(Fact, frozen=True):
    """The robot turns opposite to its command."""

    about: ClassVar[tuple[Part, ...]] = ("motors", "wheels")


class Runaway(Fact, frozen=True):
    """Wheels turn that are to stand, and what to do about it."""

    about: ClassVar[tuple[Part, ...]] = ("motors",)
    cause: AnyFact
    is_cut: bool
    is_contactor_stuck: bool

    @property
    def variant(self) -> str:
        return "stuck" if self.is_contactor_stuck else "cut" if self.is_cut else "driven"


class TurnsDisagree(Fact, frozen=True):
    """Gyro and wheels contradict each other."""

    about: ClassVar[tuple[Part, ...]] = ("imu", "wheels")
    gyro_radps: float
    wheels_radps: float


class HeldInTurn(Fact, frozen=True):
    """The robot does not turn with its wheels."""

    about: ClassVar[tuple[Part, ...]] = ("ground",)
    gyro_radps: float
    wheels_radps: float


class Stuck(Fact, frozen=True):
    """The robot stays behind its wheels."""

    about: ClassVar[tuple[Part, ...]] = ("ground",)
    way_m: float
    lasted_s: float
    moved_m: float
