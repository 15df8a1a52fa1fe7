"""What a field, its plan or a prescription of it is refused for."""

from __future__ import annotations

from typing import Literal

from agribot.core.facts.mission import MissionNote

Elsewhere = Literal["east_west", "north_south", "exchanged", "other"]


class FileKindUnknown(MissionNote, frozen=True):
    """No reader has the ending of a file."""

    file: str
    known: str


class NothingDrawn(MissionNote, frozen=True):
    """A file holds nothing that could be a field."""

    file: str


class EndingUnknown(MissionNote, frozen=True):
    """No writer has the ending of a name."""

    name: str
    known: str


class NoSuchField(MissionNote, frozen=True):
    """A file has no field, or line, of a name."""

    file: str
    name: str
    fields: str
    lines: str | None = None

    @property
    def variant(self) -> str:
        return "fields" if self.lines is None else "lines"


class SeveralFields(MissionNote, frozen=True):
    """A file has several fields, or lines, and one is to be chosen."""

    file: str
    count: int
    of: Literal["fields", "lines"]
    names: str
    example: str

    @property
    def variant(self) -> str:
        return self.of


class TaskDataOfOne(MissionNote, frozen=True):
    """Task data holds one field, and there are several."""

    count: int
    names: str


class KindUnknown(MissionNote, frozen=True):
    """A feature is of an unknown kind."""

    where: str
    named: str
    known: str


class ShapeWrong(MissionNote, frozen=True):
    """A feature has another geometry than its kind."""

    where: str
    named: str
    needed: str
    found: str


class BoundaryCount(MissionNote, frozen=True):
    """A field has not exactly one boundary."""

    file: str
    count: int
    names: str


class ManyAbLines(MissionNote, frozen=True):
    """A field has several lines along which its swaths could run."""

    file: str
    count: int
    names: str


class MarginWrong(MissionNote, frozen=True):
    """The margin of a boundary is no length, or too long."""

    where: str
    margin: str
    limit_m: float


class FieldFar(MissionNote, frozen=True):
    """A field is too far from the origin of its map; `instead`: as it may have been meant."""

    file: str
    away_m: float
    lat_deg: float
    lon_deg: float
    limit_m: float
    origin: str
    instead: str = ""

    @property
    def variant(self) -> str:
        return "swapped" if self.instead else "far"


class ObstaclesEverywhere(MissionNote, frozen=True):
    """The obstacles leave nothing of a field."""

    file: str


class KeptOutEverywhere(MissionNote, frozen=True):
    """The areas to keep out of leave nothing of a field."""


class RingShort(MissionNote, frozen=True):
    """An area has too few corners."""

    name: str
    corners: int


class RingFlat(MissionNote, frozen=True):
    """An area encloses nothing."""

    name: str


class RingCrosses(MissionNote, frozen=True):
    """The edge of an area crosses itself, at a place if that is stated."""

    name: str
    at: str = ""

    @property
    def variant(self) -> str:
        return "at" if self.at else "plain"


class ObstacleOutside(MissionNote, frozen=True):
    """An obstacle lies outside the field, at a place if that is stated."""

    name: str
    at: str = ""

    @property
    def variant(self) -> str:
        return "at" if self.at else "plain"


class LineShort(MissionNote, frozen=True):
    """A line of a field has no length, at a place if that is stated."""

    name: str
    length_m: float
    limit_m: float
    at: str = ""

    @property
    def variant(self) -> str:
        return "at" if self.at else "plain"


class AbLineClosed(MissionNote, frozen=True):
    """The line along which swaths run ends where it begins, at a place if that is stated."""

    file: str
    at: str = ""

    @property
    def variant(self) -> str:
        return "at" if self.at else "plain"


class RowOutside(MissionNote, frozen=True):
    """A part of a row lies outside the field or in an obstacle; `at`: its first place."""

    file: str
    row: int
    length_m: float
    at: str = ""

    @property
    def variant(self) -> str:
        return "at" if self.at else "plain"


class MapLarge(MissionNote, frozen=True):
    """A map of a field has too many cells along a side."""

    east_m: float
    north_m: float
    resolution_m: float
    cells: int
    limit: int


class NotPlan(MissionNote, frozen=True):
    """A file is no plan of this format."""

    file: str
    format: str


class PlanBroken(MissionNote, frozen=True):
    """A part of a plan is broken."""

    where: str
    error: str


class LegUnfit(MissionNote, frozen=True):
    """A leg of a plan is no line."""

    where: str


class NothingDriven(MissionNote, frozen=True):
    """No row was driven that could be drawn."""


class RateOutside(MissionNote, frozen=True):
    """A rate of a prescription is no rate."""

    file: str
    rate_lpha: float
    limit_lpha: float


class NotInDegrees(MissionNote, frozen=True):
    """The coordinates of a prescription are no degrees."""

    file: str


class ZonesFar(MissionNote, frozen=True):
    """The zones of a prescription are far from the field."""

    file: str
    away_m: float
    why: Literal["exchanged", "other"]

    @property
    def variant(self) -> str:
        return self.why


class ZonesElsewhere(MissionNote, frozen=True):
    """A field lies outside all zones of its prescription."""

    file: str
    why: Elsewhere

    @property
    def variant(self) -> str:
        return self.why


class ZoneShort(MissionNote, frozen=True):
    """A zone has a ring of too few corners."""

    corners: int


class ZoneCrosses(MissionNote, frozen=True):
    """The edge of a zone crosses itself."""

    at: str
