"""What a command or the start of a run is refused for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agribot.core.facts.mission import MissionNote

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact


class FilesNeeded(MissionNote, frozen=True):
    """A command needs two files."""

    example: str


class FieldNeeded(MissionNote, frozen=True):
    """A plan needs its field."""


class PlanNeeded(MissionNote, frozen=True):
    """There is no plan to verify."""


class AbLineUnfit(MissionNote, frozen=True):
    """The ends of an A-B line are one place, or too far."""

    given: str
    shortest_m: float
    farthest_m: float


class OptionOutside(MissionNote, frozen=True):
    """The value of an option is outside its limits."""

    option: str
    value: float
    low: float
    high: float


class NumbersExpected(MissionNote, frozen=True):
    """An option does not have as many numbers as it needs."""

    option: str
    given: str
    count: int

    @property
    def variant(self) -> str:
        return "one" if self.count == 1 else "several"


class OptionLatitude(MissionNote, frozen=True):
    """The latitude of an option is no latitude."""

    lat_deg: float


class NothingToClear(MissionNote, frozen=True):
    """A new run has no stop that could be cleared."""


class RunUnreadable(MissionNote, frozen=True):
    """The saved mission of a run cannot be read."""

    path: str
    error: str


class MissionBroken(MissionNote, frozen=True):
    """The saved mission of a run is broken."""

    path: str
    error: str


class MissionDone(MissionNote, frozen=True):
    """The saved mission of a run is done."""

    folder: str


class CutOffStanding(MissionNote, frozen=True):
    """A run stood when it was cut off, and no operator can clear that."""

    folder: str
    cause: AnyFact
    asks_first: bool

    @property
    def variant(self) -> str:
        return "asks" if self.asks_first else "stands"


class StillStopped(MissionNote, frozen=True):
    """A platform was stopped, and the stop is not cleared."""

    platform: str
    since: str
    cause: AnyFact


class DisarmedAlone(MissionNote, frozen=True):
    """A platform begins disarmed, and no operator can arm it."""

    platform: str


class SentAway(MissionNote, frozen=True):
    """The operator had sent the robot away from its work."""
