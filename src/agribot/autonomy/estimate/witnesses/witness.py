"""The one type of everything that speaks against a sensor, those of installed packages included."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

from agribot.core.facts import Fact
from agribot.core.messages import SensorBatch, SensorState


class Finding(NamedTuple):
    """Something that speaks against a sensor at this moment; `must_ask`: a person has to decide."""

    sensor: str
    state: SensorState
    fact: Fact
    must_ask: bool = False


class Witness(Protocol):
    """Compares what sensors say, each tick, and reports what is wrong."""

    def update(self, batch: SensorBatch) -> None:
        """Take what was measured; the pose has been corrected by it."""

    def findings(self, t_s: float) -> Iterable[Finding]:
        """Report what is wrong at a time, the worst first."""

    def forget(self) -> None:
        """Drop what was found: a person said where the robot is, or decided to go on."""


def forget_nothing() -> None:
    """Stand for what ends by itself."""


class FedWatch(NamedTuple):
    """A witness which the filter feeds where it measures: what it finds, and how it forgets."""

    sensor: str
    state: SensorState
    find: Callable[[float], Fact | None]
    drop: Callable[[], None] = forget_nothing

    def update(self, batch: SensorBatch) -> None:
        """Take nothing: the filter has fed it."""

    def findings(self, t_s: float) -> tuple[Finding, ...]:
        fact = self.find(t_s)
        return () if fact is None else (Finding(self.sensor, self.state, fact),)

    def forget(self) -> None:
        self.drop()
