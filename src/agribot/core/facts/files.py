"""What a file of waypoints, a field or a map is refused for while it is read."""

from __future__ import annotations

from typing import Literal

from agribot.core.facts.mission import MissionNote


class FileUnreadable(MissionNote, frozen=True):
    """The system does not let a file be read."""

    path: str
    error: str


class FileLarge(MissionNote, frozen=True):
    """A file is larger than the limit."""

    file: str
    size_bytes: int
    limit_bytes: int


class FileEmpty(MissionNote, frozen=True):
    """There is nothing in a file."""

    file: str


class FileBroken(MissionNote, frozen=True):
    """The content of a file is broken; `is_advised`: the error says what to do."""

    file: str
    error: str
    is_advised: bool = False

    @property
    def variant(self) -> str:
        return "advised" if self.is_advised else "plain"


class CsvBroken(MissionNote, frozen=True):
    """A file is no valid CSV."""

    file: str
    error: str


class JsonBroken(MissionNote, frozen=True):
    """A file is no valid JSON, from a line on; 0: the line is not known."""

    file: str
    error: str
    line: int = 0

    @property
    def variant(self) -> str:
        return "line" if self.line else "plain"


class HeaderMissing(MissionNote, frozen=True):
    """The first line of a CSV file names no latitude and longitude."""

    file: str
    found: str


class ValuesMissing(MissionNote, frozen=True):
    """A line of a CSV file is shorter than its header."""

    where: str
    values_count: int
    columns: int


class ManyWaypoints(MissionNote, frozen=True):
    """A file holds more waypoints than are planned at once."""

    file: str
    limit: int


class NoWaypointsIn(MissionNote, frozen=True):
    """A file holds no waypoints."""

    file: str


class WaypointOffField(MissionNote, frozen=True):
    """A waypoint of a file is too far from the origin of the map."""

    file: str
    waypoint: int
    away_m: float
    limit_m: float


class LatitudeOutside(MissionNote, frozen=True):
    """A latitude is no latitude."""

    where: str
    lat_deg: float


class LongitudeOutside(MissionNote, frozen=True):
    """A longitude is no longitude."""

    where: str
    lon_deg: float


class AtNullIsland(MissionNote, frozen=True):
    """A place is exactly 0, 0, which devices write that have no fix."""

    where: str


class NotDegrees(MissionNote, frozen=True):
    """A value is no number of degrees; `has_comma`: it may be one with a decimal comma."""

    where: str
    value: str
    has_comma: bool = False

    @property
    def variant(self) -> str:
        return "comma" if self.has_comma else "plain"


class NotGeojson(MissionNote, frozen=True):
    """A part of a file is no GeoJSON object but of another type."""

    where: str
    found: str


class ListMissing(MissionNote, frozen=True):
    """A GeoJSON object lacks its list."""

    where: str
    of: str
    name: str


class GeometryUnfit(MissionNote, frozen=True):
    """A geometry is of a type that has no use here."""

    where: str
    geometry: str
    use: Literal["waypoints", "field", "shapes"]

    @property
    def variant(self) -> str:
        return self.use


class NotPositions(MissionNote, frozen=True):
    """Coordinates are no list of positions."""

    where: str


class NotPosition(MissionNote, frozen=True):
    """A position is no longitude and latitude."""

    where: str
    value: str


class GeometryMissing(MissionNote, frozen=True):
    """A feature has no geometry."""

    where: str


class LatLonSwapped(MissionNote, frozen=True):
    """Latitude and longitude seem to be swapped."""

    where: str
    lat_deg: float
    instead: str


class NotLonLat(MissionNote, frozen=True):
    """Two numbers are no longitude and latitude in degrees."""

    where: str
    value: str


class OtherCoordinates(MissionNote, frozen=True):
    """A file has coordinates of another system."""

    file: str
    crs: str


class ManyPoints(MissionNote, frozen=True):
    """A file has more points than the limit."""

    file: str
    points: int
    limit: int
