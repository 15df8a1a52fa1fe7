"""What a request is refused for."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from agribot.core.facts.base import Part
from agribot.core.facts.mission import MissionNote

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact


class NotStarted(MissionNote, frozen=True):
    """The mission was not started."""

    cause: AnyFact


class RowNotSkipped(MissionNote, frozen=True):
    """The row was not left out."""

    cause: AnyFact


class RowNotMoved(MissionNote, frozen=True):
    """The line of the row was not moved."""

    cause: AnyFact


class TaskRefused(MissionNote, frozen=True):
    """Another task was not taken."""

    task: Literal["plan", "visit"]
    cause: AnyFact


class SpeedRefused(MissionNote, frozen=True):
    """A speed is more than the robot may drive."""

    speed_mps: float
    limit_mps: float


class MissionEnded(MissionNote, frozen=True):
    """The mission has ended; `can_start`: a start begins it once more."""

    can_start: bool = False

    @property
    def variant(self) -> str:
        return "open" if self.can_start else "closed"


class StopHolds(MissionNote, frozen=True):
    """The stop must be cleared first."""


class NothingPlanned(MissionNote, frozen=True):
    """There is no route yet."""


class AwayFromRows(MissionNote, frozen=True):
    """The robot is on an errand."""


class InNoRow(MissionNote, frozen=True):
    """The robot is in no row."""


class RowMovedFar(MissionNote, frozen=True):
    """The line of a row is as far aside as it may be."""

    row: int
    limit_m: float


class NoOtherTask(MissionNote, frozen=True):
    """The mission takes no other task."""


class RobotDrives(MissionNote, frozen=True):
    """The robot must stand for it."""


class AskedElse(MissionNote, frozen=True):
    """Another request took its place."""


class OwnPathOnly(MissionNote, frozen=True):
    """The task knows no ways beside its own path."""


class GoalNotFinite(MissionNote, frozen=True):
    """A goal is no number."""


class NoPlaces(MissionNote, frozen=True):
    """A visit names no places."""


class ThereAlready(MissionNote, frozen=True):
    """The robot is at its goal."""


class JustSetOff(MissionNote, frozen=True):
    """The robot has not come far enough to back out on its track."""


class AllRowsWorked(MissionNote, frozen=True):
    """No row is left to resume."""


class TooFarAway(MissionNote, frozen=True):
    """The nearest place to drive to is too far from the robot."""

    away_m: float
    limit_m: float


class BeyondFence(MissionNote, frozen=True):
    """A place lies beyond the fence around the task."""

    x_map_m: float
    y_map_m: float
    beyond_m: float


class OnCropThere(MissionNote, frozen=True):
    """The robot would stand on crop at a place."""

    x_map_m: float
    y_map_m: float


class NoWayOffCrop(MissionNote, frozen=True):
    """No way to a place keeps off the crop, for a reason of the planner."""

    x_map_m: float
    y_map_m: float
    cause: AnyFact


class CarriedAway(MissionNote, frozen=True):
    """The robot is not where its work stopped."""

    about: ClassVar[tuple[Part, ...]] = ("robot",)
    away_m: float
    x_map_m: float
    y_map_m: float
    limit_m: float


class NoAnswer(MissionNote, frozen=True):
    """The robot did not answer a request in time."""

    limit_s: float


class NoFrameSeen(MissionNote, frozen=True):
    """The network has not seen a picture yet."""


class CalibrationRuns(MissionNote, frozen=True):
    """A calibration is under way."""


class NothingSeen(MissionNote, frozen=True):
    """The robot has no pictures for a calibration."""


class NoResult(MissionNote, frozen=True):
    """No calibration has a result to take over."""


class NoSuchCalibration(MissionNote, frozen=True):
    """The robot has no calibration of this name; `known` are those that it has."""

    name: str
    known: str


class AtHome(MissionNote, frozen=True):
    """The robot is at home."""


class NoRoomToFace(MissionNote, frozen=True):
    """The robot cannot look that way at a place."""

    x_map_m: float
    y_map_m: float


class FarFromGround(MissionNote, frozen=True):
    """A place is too far from the ground on which the robot may drive."""

    x_map_m: float
    y_map_m: float
    away_m: float
    limit_m: float


class WayRefused(MissionNote, frozen=True):
    """The certificate of a way there is not given, for a reason of the planner."""

    cause: AnyFact


class WayCrossesCrop(MissionNote, frozen=True):
    """The way would cross crop, for a reason of the planner."""

    cause: AnyFact


class NoHeadland(MissionNote, frozen=True):
    """The crop rows leave no headland."""


class NoClearWay(MissionNote, frozen=True):
    """No way to the field keeps off the crop, and off obstacles where there are any."""

    x_map_m: float
    y_map_m: float
    crop_m: float
    obstacles_m: float | None = None

    @property
    def variant(self) -> str:
        return "plain" if self.obstacles_m is None else "obstacles"


class WaypointPassed(MissionNote, frozen=True):
    """A path passes a waypoint at too great a distance."""

    waypoint: int
    away_m: float
    limit_m: float


class RowsUnknown(MissionNote, frozen=True):
    """A path works rows that the field has not."""

    rows: tuple[int, ...]


class NoWaypoints(MissionNote, frozen=True):
    """A list of waypoints is empty."""


class WaypointFar(MissionNote, frozen=True):
    """A waypoint is too far from a robot of this name."""

    waypoint: int
    robot: str
    away_m: float
    limit_m: float


class WaypointsSame(MissionNote, frozen=True):
    """Two waypoints are one place."""

    first: int
    second: int


class VisitPathOnly(MissionNote, frozen=True):
    """A visit drives its own path only."""

    name: str


class PlaceUnfit(MissionNote, frozen=True):
    """The robot cannot turn at a place."""

    x_map_m: float
    y_map_m: float
    lies: Literal["beyond", "obstacle", "crop", "edge"]

    @property
    def variant(self) -> str:
        return self.lies
