"""Fixes of NMEA sentences: those of one epoch joined, whichever of them state the place.

Sources: NMEA 0183 (GGA, GNS, RMC, GLL, VTG, GST); u-blox M10 interface description
(UBXDOC-304424225-19889) for the flags of position modes; Quectel LC29H and LG290P protocol
specifications (PQTMPVT, PQTMVEL, PQTMEPE).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from agribot.core.geo import is_nowhere, is_place
from agribot.core.messages import GnssFix, GnssQuality, Vec3
from agribot.drivers.fix_kinds import DEAD_RECKONING, HELD, FixKind, make_fields
from agribot.drivers.nmea import (
    DAY_S,
    KNOT_MPS,
    Sentence,
    StampedFix,
    read_degrees,
    read_finite,
    read_time_of_day_s,
)

PAUSE_S = 0.5  # after which no more sentences of an epoch come
MINUTE_M = 1852.0  # of latitude
# 1 sigma of one horizontal axis where no GST states it, at an HDOP of 1.
STD_M: dict[FixKind, float] = {
    GnssQuality.SINGLE: 2.5,
    GnssQuality.DGNSS: 1.0,
    GnssQuality.RTK_FLOAT: 0.3,
    GnssQuality.RTK_FIXED: 0.02,
    DEAD_RECKONING: 30.0,
    HELD: 30.0,
}
# GGA's field 6.
QUALITY: dict[int, FixKind] = {
    1: GnssQuality.SINGLE,
    2: GnssQuality.DGNSS,
    3: GnssQuality.SINGLE,  # PPS
    4: GnssQuality.RTK_FIXED,
    5: GnssQuality.RTK_FLOAT,
    6: DEAD_RECKONING,
    7: HELD,  # manual input
    9: GnssQuality.DGNSS,  # SBAS, of NovAtel
}
SIMULATED = "8"
# Position modes of RMC, GLL, GNS and VTG, the best first.
MODES: dict[str, FixKind] = {
    "R": GnssQuality.RTK_FIXED,
    "F": GnssQuality.RTK_FLOAT,
    "D": GnssQuality.DGNSS,
    "P": GnssQuality.SINGLE,
    "A": GnssQuality.SINGLE,
    "E": DEAD_RECKONING,
    "M": HELD,
}
# Where the time of day stands in sentences that have one.
TIME_FIELDS = {"GGA": 0, "GNS": 0, "RMC": 0, "GST": 0, "GLL": 4, "PQTMPVT": 3, "PQTMVEL": 1}
TIMELESS = ("VTG", "PQTMEPE")
MOST_FIELDS = 20
PLACE_KINDS = ("GGA", "GNS", "RMC", "PQTMPVT", "GLL")  # the one that states most first

Parts = dict[str, tuple[str, ...]]


class Place(NamedTuple):
    """What a sentence says of the place; `quality` is None where it states none.

    `resolution_m` is the last digit of its latitude.
    """

    where: tuple[float, float] | None  # latitude and longitude, degrees
    quality: FixKind | None
    resolution_m: float
    hdop: str = ""
    alt: str = ""
    separation: str = ""

    @property
    def is_fix(self) -> bool:
        """Whether it states a place and a quality: 0, 0 is no place, whatever the quality."""
        has_place = self.where is not None and not is_nowhere(*self.where)
        return has_place and self.quality not in (None, GnssQuality.NONE)


class NmeaFixes:
    """Joins the sentences of an epoch to a fix.

    An epoch ends with the kind of sentence that ended the one before it, so that a fix waits for
    no other, or else where the next one begins. Sentences without a time belong to the epoch that
    is nearer by their arrival: receivers pause between epochs.
    """

    def __init__(self, refuse: Callable[[str], None]) -> None:
        self._refuse = refuse
        self._time_of_day_s = math.nan
        self._days_s = 0.0
        self._parts: Parts = {}
        self._last_kind, self._last_timed_kind, self._ending_kind = "", "", ""
        self._is_given = True
        self._arrived_s = self._pause_s = 0.0  # the longest since the last sentence with a time
        self._timeless: dict[str, tuple[tuple[str, ...], float]] = {}  # with the pause before
        self._leading: set[str] = set()  # of these, those before the first one with a time

    def add(self, sentence: Sentence, arrived_s: float = 0.0) -> list[StampedFix]:
        """Add a sentence; gives the fixes that it completes."""
        pause_s, self._arrived_s = arrived_s - self._arrived_s, arrived_s
        self._pause_s = max(self._pause_s, pause_s)
        kind, fields = sentence.kind, sentence.fields
        if kind in TIMELESS:
            return self._add_timeless(kind, fields)
        field = TIME_FIELDS.get(kind)
        text = "" if field is None or len(fields) <= field else fields[field]
        if not text:
            return []
        try:
            time_of_day_s = read_time_of_day_s(text)
        except ValueError:
            self._refuse(f"{kind} with the time {text!r}")
            return []
        finished: list[StampedFix] = []
        if time_of_day_s != self._time_of_day_s:
            finished = self._make()
            self._begin(time_of_day_s, pause_s)
        self._pause_s = 0.0
        self._parts[kind] = fields
        self._last_kind = self._last_timed_kind = kind
        return finished + self._end(kind)

    def give_waiting(self, arrived_s: float) -> list[StampedFix]:
        """Give the epoch whose last sentence does not come, once the receiver pauses."""
        return self._make() if arrived_s - self._arrived_s > PAUSE_S else []

    @property
    def stamp_s(self) -> float:
        """Of the epoch that its sentences are about now; 0 before the first."""
        return self._make_stamp_s(self._time_of_day_s)

    def find_stamp_s(self, time_text: str) -> float:
        """Find the stamp of a time of day of now; that of the present epoch without a time."""
        try:
            time_of_day_s = read_time_of_day_s(time_text)
        except ValueError:
            return self.stamp_s
        return self._make_stamp_s(time_of_day_s) if self.stamp_s else 0.0

    def _make_stamp_s(self, time_of_day_s: float) -> float:
        is_known = math.isfinite(time_of_day_s)
        # Not zero at midnight, which would count as none.
        return self._days_s + time_of_day_s + DAY_S if is_known else 0.0

    def _add_timeless(self, kind: str, fields: tuple[str, ...]) -> list[StampedFix]:
        self._timeless[kind] = fields, self._pause_s
        if kind in self._leading or not self._parts:
            return []
        self._parts[kind] = fields
        self._last_kind = kind
        return self._end(kind)

    def _end(self, kind: str) -> list[StampedFix]:
        return self._make() if kind == self._ending_kind else []

    def _begin(self, time_of_day_s: float, pause_s: float) -> None:
        leading = {kind for kind, (_, before_s) in self._timeless.items() if before_s > pause_s}
        self._leading = self._leading - set(self._timeless) | leading
        is_trailed = self._last_kind not in self._leading
        self._ending_kind = self._last_kind if is_trailed else self._last_timed_kind
        self._parts = {kind: self._timeless[kind][0] for kind in leading}
        self._timeless.clear()
        if time_of_day_s < self._time_of_day_s - DAY_S / 2.0:
            self._days_s += DAY_S
        self._time_of_day_s, self._is_given = time_of_day_s, False

    def _make(self) -> list[StampedFix]:
        if self._is_given:
            return []
        self._is_given = True
        try:
            fix = make_fix(self._parts)
        except (ValueError, IndexError) as error:
            self._refuse(f"a fix that cannot be read: {error}")
            return []
        return [StampedFix(self.stamp_s, fix)] if fix else []


def make_fix(parts: Parts) -> GnssFix | None:
    """Make a fix of the fields of one epoch by kind; None while the receiver has no position.

    The altitude is that over the ellipsoid, NaN where altitude or geoid separation is missing.
    Raises: ValueError, IndexError: fields that are no numbers, out of range, or missing.
    """
    places = (read_place(kind, parts[kind]) for kind in PLACE_KINDS if kind in parts)
    place = next((one for one in places if one.quality is not None), None)
    if place is None or place.quality is None or place.where is None or not place.is_fix:
        return None
    return GnssFix(
        t_s=0.0,
        lat_deg=place.where[0],
        lon_deg=place.where[1],
        alt_m=_read_altitude_m(place),
        pos_std_m=_read_std_m(parts, place, STD_M[place.quality]),
        **make_fields(place.quality),
        velocity_mps=_read_velocity(parts),
    )


def read_place(kind: str, fields: tuple[str, ...]) -> Place:
    """Read a sentence of PLACE_KINDS; fields that are missing are empty.

    Raises: ValueError: fields that are no numbers, or out of range.
    """
    fields += ("",) * (MOST_FIELDS - len(fields))
    if kind == "GGA":
        quality = _read_quality(fields[5], fields[6])
        return Place(*_read_where(fields[1:5], quality), fields[7], fields[8], fields[10])
    if kind == "GNS":
        quality = _read_modes(fields[5])
        return Place(*_read_where(fields[1:5], quality), fields[7], fields[8], fields[9])
    if kind == "RMC":
        return Place(*_read_where(fields[2:6], _read_status(fields[1], fields[11:12])))
    if kind == "GLL":
        return Place(*_read_where(fields[:4], _read_status(fields[5], fields[6:7])))
    return _read_quectel(fields)


def _read_where(
    fields: tuple[str, ...], quality: FixKind | None
) -> tuple[tuple[float, float] | None, FixKind | None, float]:
    """Read latitude and longitude, unless the sentence says itself that they are none."""
    lat, north, lon, east = fields
    if not lat or not lon or quality is GnssQuality.NONE:
        return None, quality, 0.0
    where = read_degrees(lat, north, "NS", 90.0), read_degrees(lon, east, "EW", 180.0)
    return where, quality, MINUTE_M * 10.0 ** -len(lat.partition(".")[2])


def _read_quectel(fields: tuple[str, ...]) -> Place:
    """Read PQTMPVT, in degrees, whose fix type says nothing of corrections."""
    is_fix = fields[5] in ("2", "3")
    where = (read_finite(fields[8]), read_finite(fields[9])) if is_fix else None
    if where is not None and not is_place(*where):
        raise ValueError(f"{fields[8]}, {fields[9]} is no place")
    quality = GnssQuality.SINGLE if is_fix else GnssQuality.NONE
    return Place(where, quality, 0.0, fields[17], fields[10], fields[11])


def lacks_fix(sentence: Sentence) -> bool:
    """Tell whether a sentence is one of a receiver that has no position yet, or no more.

    Raises: ValueError, IndexError: a quality that is no number, or too few fields.
    """
    is_about = sentence.kind in PLACE_KINDS
    return is_about and not read_place(sentence.kind, sentence.fields).is_fix


def explain(sentence: Sentence) -> str:
    """Say why a sentence without a fix gives none, where its receiver does not search."""
    if sentence.kind != "GGA":
        return ""
    quality, satellites = sentence.fields[5:7]
    if quality == SIMULATED:
        return "its positions are simulated (GGA's quality is 8); switch its simulator off"
    is_old = quality not in ("", "0") and satellites and not int(satellites)
    return "its positions are of no satellite; give its antenna the open sky" if is_old else ""


def _read_quality(text: str, satellites: str) -> FixKind | None:
    """Read GGA's; None of a fix of no satellite, which another sentence may know better."""
    if not text:
        return None
    quality = QUALITY.get(int(text), GnssQuality.NONE)
    has_none = bool(satellites) and int(satellites) == 0
    is_measured = quality not in (GnssQuality.NONE, DEAD_RECKONING, HELD)
    return None if has_none and is_measured else quality


def _read_modes(modes: str) -> FixKind:
    """Read the modes of GNS, one for each system of satellites: the best one counts."""
    return next((MODES[mode] for mode in MODES if mode in modes), GnssQuality.NONE)


def _read_status(status: str, mode: tuple[str, ...]) -> FixKind:
    """Read status and mode of RMC and GLL; before NMEA 2.3 there was no mode."""
    if status != "A":
        return GnssQuality.NONE
    return _read_modes(mode[0]) if mode and mode[0] else GnssQuality.SINGLE


def _read_std_m(parts: Parts, place: Place, usual_m: float) -> float:
    """Read GST's or PQTMEPE's, or take what is usual; not less than the last digit of the place."""
    for axes in (parts.get("GST", ())[5:7], parts.get("PQTMEPE", ())[1:3]):
        std_m = math.hypot(*map(read_finite, axes)) / math.sqrt(2.0) if all(axes) else 0.0
        if std_m > 0.0:
            break
    else:
        std_m = usual_m * max(1.0, read_finite(place.hdop or "1"))
    return max(std_m, place.resolution_m / math.sqrt(12.0))


def _read_velocity(parts: Parts) -> Vec3 | None:
    """Read East, North and up; None where no sentence states both speed and course.

    At a speed of zero no course is needed.
    """
    for axes in (parts.get("PQTMVEL", ())[2:5], parts.get("PQTMPVT", ())[12:15]):
        if axes and all(axes):
            north_mps, east_mps, down_mps = map(read_finite, axes)
            return east_mps, north_mps, -down_mps
    rmc, vtg = parts.get("RMC", ()), parts.get("VTG", ())
    stated = [rmc[6:8]] if rmc[1:2] == ("A",) else []
    stated += [(vtg[4], vtg[0])] if len(vtg) > 4 and vtg[8:9] != ("N",) else []
    found = (_make_velocity(speed, course) for speed, course in stated if speed)
    return next((velocity_mps for velocity_mps in found if velocity_mps is not None), None)


def _make_velocity(speed_knots: str, course_deg: str) -> Vec3 | None:
    speed_mps = KNOT_MPS * read_finite(speed_knots)
    if speed_mps == 0.0:
        return 0.0, 0.0, 0.0
    if not course_deg:
        return None
    course_rad = math.radians(read_finite(course_deg))
    return speed_mps * math.sin(course_rad), speed_mps * math.cos(course_rad), 0.0


def _read_altitude_m(place: Place) -> float:
    """Read the altitude over the ellipsoid: that over the sea, and how far the sea is from it."""
    if not place.alt or not place.separation:
        return math.nan
    return read_finite(place.alt) + read_finite(place.separation)
