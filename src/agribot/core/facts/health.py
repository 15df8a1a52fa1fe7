"""How the robot and its program are, as a page shows it."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from agribot.core.facts.base import Fact, Part, Severity

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact


class ProgramEnded(Fact, frozen=True):
    """The robot's program is gone."""

    about: ClassVar[tuple[Part, ...]] = ("program",)


class ProgramSilent(Fact, frozen=True):
    """The robot's program has sent no tick for a while."""

    about: ClassVar[tuple[Part, ...]] = ("program",)
    silent_s: float


class _OfHealth(Fact, frozen=True):
    severity: ClassVar[Severity] = "note"


class NoTickYet(_OfHealth, frozen=True):
    """The robot's program has sent no tick yet."""


class TicksArrive(_OfHealth, frozen=True):
    """The robot's program runs."""


class PositionKnown(_OfHealth, frozen=True):
    """How well the position is known."""

    std_m: float
    is_poor: bool

    @property
    def variant(self) -> str:
        return "poor" if self.is_poor else "good"


class PositionUnknown(_OfHealth, frozen=True):
    """There is no position, and perhaps why."""

    cause: AnyFact | None = None

    @property
    def variant(self) -> str:
        return "plain" if self.cause is None else "why"


class BatteryHolds(_OfHealth, frozen=True):
    """Voltage and charge of the battery."""

    voltage_v: float
    charge_percent: float | None
    is_low: bool

    @property
    def variant(self) -> str:
        if self.charge_percent is None:
            return "volts"
        return "low" if self.is_low else "charge"


class RateLow(Fact, frozen=True):
    """Something comes less often than it should."""

    severity: ClassVar[Severity] = "warning"
    measured_hz: float
    expected_hz: float


class DiskFree(_OfHealth, frozen=True):
    """Room on the disk."""

    about: ClassVar[tuple[Part, ...]] = ("disk",)
    free_gb: float
    is_low: bool

    @property
    def variant(self) -> str:
        return "low" if self.is_low else "enough"


class PagesConnected(_OfHealth, frozen=True):
    """Pages, the states that were too old for them, and the clients that were turned away."""

    pages: int
    states_left_out: int
    refused: int
