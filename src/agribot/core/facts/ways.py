"""What a way, a plan of a field or its rows are refused for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from agribot.core.facts.mission import MissionNote

if TYPE_CHECKING:
    from agribot.core.facts.base import AnyFact


PathRule = Literal["spacing", "distance", "heading"]  # properties of a path


class NearObstacle(MissionNote, frozen=True):
    """A path comes too close to an obstacle of the settings."""

    x_map_m: float
    y_map_m: float
    away_m: float
    obstacle_x_map_m: float
    obstacle_y_map_m: float
    needed_m: float


class NearKeptOut(MissionNote, frozen=True):
    """A path comes too close to an area to keep out of, or leads through it."""

    x_map_m: float
    y_map_m: float
    away_m: float
    area_x_map_m: float
    area_y_map_m: float
    needed_m: float


class RowsAsFound(MissionNote, frozen=True):
    """An exploring robot drives its rows in the order of discovery."""


class RowsAsPlanned(MissionNote, frozen=True):
    """The rows of a field plan are driven in its order."""


class NoRowsThere(MissionNote, frozen=True):
    """A way through waypoints has no rows to leave out."""


class OtherMission(MissionNote, frozen=True):
    """The saved mission is another one than that of the settings."""

    saved_m: float
    length_m: float


class OverCrop(MissionNote, frozen=True):
    """A wheel comes too close to a row or a plant; below zero it drives over it."""

    wheel: str
    crop: Literal["row", "plant"]
    number: int
    x_map_m: float
    y_map_m: float
    along_m: float
    clearance_m: float
    needed_m: float

    @property
    def variant(self) -> str:
        return ("over_" if self.clearance_m < 0.0 else "near_") + self.crop


class PathShort(MissionNote, frozen=True):
    """A path has less than two points."""

    points: int


class PathNotFinite(MissionNote, frozen=True):
    """A point of a path is no number."""

    point: int


class PathBroken(MissionNote, frozen=True):
    """The points of a path contradict each other at a place."""

    rule: PathRule
    limit_m: float
    x_map_m: float
    y_map_m: float
    along_m: float

    @property
    def variant(self) -> str:
        return self.rule


class PathTight(MissionNote, frozen=True):
    """A path turns tighter than the robot can."""

    radius_m: float
    x_map_m: float
    y_map_m: float
    along_m: float


class PathWithoutLength(MissionNote, frozen=True):
    """A path ends where it begins."""


class RowsBent(MissionNote, frozen=True):
    """The rows of the settings are bent too tightly."""

    bend_radpm: float
    turn_rad: float
    narrowest_ratio: float
    limit_ratio: float


class NoRows(MissionNote, frozen=True):
    """A field has no rows."""


class RowShort(MissionNote, frozen=True):
    """A row is too short to be driven."""

    row: int
    limit_m: float


class RowsTight(MissionNote, frozen=True):
    """Two rows, counted from 1, leave no room for the wheels of a robot."""

    row: int
    other: int
    robot: str
    apart_m: float
    track_m: float
    wheel_width_m: float
    gap_m: float
    needed_m: float
    reach_m: float


class PlanLong(MissionNote, frozen=True):
    """A plan is longer than a mission can hold."""

    length_m: float
    limit_m: float


class NoPlaceToTurn(MissionNote, frozen=True):
    """A field has no room for the turning circle of the robot and the margin."""

    needed_m: float
    circle_m: float
    margin_m: float


class StartOutside(MissionNote, frozen=True):
    """The start lies outside the ground on which the robot can turn."""

    x_map_m: float
    y_map_m: float
    outside_m: float
    depth_m: float


class OverlapWide(MissionNote, frozen=True):
    """The overlap leaves nothing of the width of an implement."""

    overlap_m: float
    width_m: float


class ManyObstacles(MissionNote, frozen=True):
    """A field has more obstacles than can be planned around."""

    count: int
    limit: int


class ManySwaths(MissionNote, frozen=True):
    """A field has more swaths than can be planned."""

    count: int
    limit: int


class RowWithoutRoom(MissionNote, frozen=True):
    """There is no room to turn behind the ends of a row, counted from 1."""

    row: int
    room_m: float
    x_map_m: float
    y_map_m: float


class RowSharp(MissionNote, frozen=True):
    """A row, counted from 1, bends too sharply to be followed."""

    row: int
    x_map_m: float
    y_map_m: float


class NoWayInside(MissionNote, frozen=True):
    """No way between two places keeps the robot inside the field."""

    x_map_m: float
    y_map_m: float
    goal_x_map_m: float
    goal_y_map_m: float


class PlanUnfit(MissionNote, frozen=True):
    """The certificate of a plan is refused for a robot, by a rule of the certificate."""

    file: str
    robot: str
    rule: str
    cause: AnyFact


class FieldUnfit(MissionNote, frozen=True):
    """The plan of a field breaks a rule of the certificate."""

    file: str
    rule: str
    cause: AnyFact


class ImplementMissing(MissionNote, frozen=True):
    """A robot has no implement whose width could be taken."""

    robot: str


class CropOffRows(MissionNote, frozen=True):
    """Crop of a world stands off the rows of the settings; `has_rows`: the world states its own."""

    world: str
    off: int
    count: int
    limit_m: float
    has_rows: bool

    @property
    def variant(self) -> str:
        return "stated" if self.has_rows else "unstated"


class NoCropInRows(MissionNote, frozen=True):
    """No crop plant of a world stands in the rows of the settings."""

    world: str
    plants: int
    has_rows: bool

    @property
    def variant(self) -> str:
        return "stated" if self.has_rows else "unstated"


class CropMapCount(MissionNote, frozen=True):
    """A map of plants has too few or too many of crop."""

    file: str
    count: int
    fewest: int
    most: int


class CropMapWide(MissionNote, frozen=True):
    """The crop of a map of plants spreads over too large an area."""

    file: str
    area_ha: float
    limit_ha: float
