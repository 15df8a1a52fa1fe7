"""The platform's clock."""

from __future__ import annotations

from typing import ClassVar

from agribot.core.facts.base import Fact, Part, Severity


class _OfClock(Fact, frozen=True):
    about: ClassVar[tuple[Part, ...]] = ("clock",)


class PoseClockWentBack(_OfClock, frozen=True):
    """The clock went back by more than the pose can follow."""

    back_s: float


class ClockUnreadable(_OfClock, frozen=True):
    """The clock reads no finite time."""

    t_s: float


class ClockWentBack(_OfClock, frozen=True):
    """The clock went back."""

    back_s: float


class ClockJumped(_OfClock, frozen=True):
    """The clock jumped, or the program stood still."""

    about: ClassVar[tuple[Part, ...]] = ("clock", "program")
    off_s: float
    limit_s: float


class ClockStands(_OfClock, frozen=True):
    """The clock stands still."""

    t_s: float


class ClockLeapt(_OfClock, frozen=True):
    """The clock jumped between two readings of wheels that turned evenly."""

    severity: ClassVar[Severity] = "warning"
    off_s: float
