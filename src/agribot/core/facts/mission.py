"""States of the mission and their reasons."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from agribot.core.facts.base import Fact, Part, Severity

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact


class MissionNote(Fact, frozen=True):
    severity: ClassVar[Severity] = "note"


class FirstEstimateAwaited(MissionNote, frozen=True):
    """The mission waits for the first estimate."""


class PositionAwaited(MissionNote, frozen=True):
    """The mission waits for a position."""

    cause: AnyFact


class Settling(MissionNote, frozen=True):
    """The mission waits for the estimate to settle."""


class PlanningWay(MissionNote, frozen=True):
    """The way is being planned."""


class StartUnsure(Fact, frozen=True):
    """Neither the pose nor a camera knows the rows."""

    std_m: float
    limit_m: float


class OffPath(Fact, frozen=True):
    """The robot has left its path."""

    off_m: float
    limit_m: float
    x_map_m: float
    y_map_m: float


class RowLost(Fact, frozen=True):
    """The robot does not know well enough where its row is."""

    std_m: float
    limit_m: float


class MayBeOffRow(Fact, frozen=True):
    """The protection level is more than from wheels to crop."""

    level_m: float
    limit_m: float


class NoHeadway(Fact, frozen=True):
    """The robot does not get on."""

    limit_s: float
    s_m: float
    length_m: float
    cause: AnyFact | None = None

    @property
    def variant(self) -> str:
        return "plain" if self.cause is None else "why"


class NoPositionFor(Fact, frozen=True):
    """The mission has waited too long for its position."""

    limit_s: float
    cause: AnyFact


class PositionLost(Fact, frozen=True):
    """The position was lost on the way."""

    cause: AnyFact | None = None

    @property
    def variant(self) -> str:
        return "plain" if self.cause is None else "why"


class PausedBy(MissionNote, frozen=True):
    """Somebody paused the mission."""

    by: str


class PausedByHand(MissionNote, frozen=True):
    """Somebody took the robot by hand."""

    by: str


class PausedByLoss(MissionNote, frozen=True):
    """The operator is not heard any more."""

    of: str


class CancelledBy(MissionNote, frozen=True):
    """Somebody ended the mission."""

    by: str


class StopToResume(Fact, frozen=True):
    """The mission stands for a stop."""

    cause: AnyFact


class ResumeAwaited(MissionNote, frozen=True):
    """The stop was cleared, and the mission was not resumed."""


class GoalAwaited(MissionNote, frozen=True):
    """The mission waits for a goal."""


class AtGoal(MissionNote, frozen=True):
    """The robot is at the goal of somebody."""

    by: str


class StopsToReturn(MissionNote, frozen=True):
    """The robot stops to return home."""

    by: str


class StopsForGoal(MissionNote, frozen=True):
    """The robot stops for a goal."""

    by: str


class StopsToBackOut(Fact, frozen=True):
    """The robot backs out, for a cause."""

    cause: AnyFact
    leg: Literal["back", "out", "free"]


class FoundRowAside(MissionNote, frozen=True):
    """The robot found its row aside."""


class ReturnedHome(MissionNote, frozen=True):
    """The robot is at home, called by somebody."""

    by: str


class CameToBeCharged(MissionNote, frozen=True):
    """The robot is at home to be charged."""


class NewTask(MissionNote, frozen=True):
    """Somebody sent a new task."""

    action: str
    by: str


class CutOff(MissionNote, frozen=True):
    """The mission was cut off; what held it, or what it was doing."""

    cause: AnyFact


class AwayFromWork(MissionNote, frozen=True):
    """The robot was away from its work."""


class OnVisit(MissionNote, frozen=True):
    """The robot was on a visit."""

    name: str


class OnErrandOf(MissionNote, frozen=True):
    """The robot was on an errand that somebody asked for."""

    leg: str
    by: str


class NotResumed(MissionNote, frozen=True):
    """The mission was not resumed."""

    cause: AnyFact


class ErrandRefused(MissionNote, frozen=True):
    """There is no way for an errand."""

    errand: Literal["home", "charge", "goal", "work", "back", "out", "free"]
    cause: AnyFact


class RowsSkipped(MissionNote, frozen=True):
    """Rows were skipped, as asked."""

    rows: tuple[int, ...]


class RowsUndriven(Fact, frozen=True):
    """The path ended with rows that were not driven."""

    rows: tuple[int, ...]


class RowUnproven(Fact, frozen=True):
    """A row, counted from 1, was driven without evidence, over these lengths; 0: it was counted.

    The position was too uncertain to exclude the next row over `unsure_m`.
    """

    row: int
    unseen_m: float = 0.0
    unsure_m: float = 0.0

    @property
    def variant(self) -> str:
        if self.unseen_m and self.unsure_m:
            return "both"
        return "unseen" if self.unseen_m else "unsure" if self.unsure_m else "counted"


class RowsUnproven(Fact, frozen=True):
    """Rows were driven without evidence, some of them named; in words of an earlier version."""

    said: tuple[str, ...] = ()
    more: int = 0
    rows: tuple[RowUnproven, ...] = ()

    @property
    def variant(self) -> str:
        return ("said" if self.said else "known") + ("_more" if self.more else "")


class NoRowInView(Fact, frozen=True):
    """An exploring robot found no row over this way."""

    about: ClassVar[tuple[Part, ...]] = ("crop",)
    way_m: float


class RowOutOfView(Fact, frozen=True):
    """The camera of an exploring robot shows no more of a row, counted from 1."""

    about: ClassVar[tuple[Part, ...]] = ("camera",)
    row: int


class WaypointsMissed(Fact, frozen=True):
    """Waypoints were passed at too great a distance."""

    waypoints: tuple[int, ...]
    limit_m: float
