"""Places, qualities and velocities of NMEA sentences, whichever of them state the place.

Sources: NMEA 0183 (GGA, GNS, RMC, GLL, VTG, GST); u-blox M10 interface description
(UBXDOC-304424225-19889) for the flags of position modes; Quectel LC29H and LG290P protocol
specifications (PQTMPVT, PQTMVEL, PQTMEPE).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from agribot.core.geo import is_nowhere, is_place
from agribot.core.messages import GnssFix, GnssQuality, Vec3
from agribot.drivers.gnss.fix_kinds import DEAD_RECKONING, HELD, FixKind, make_fields
from agribot.drivers.gnss.nmea import (
    KNOT_MPS,
    Sentence,
    read_degrees,
    read_finite,
)

MINUTE_M = 1852.0  # length of a minute of latitude
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
MOST_FIELDS = 20
PLACE_KINDS = ("GGA", "GNS", "RMC", "PQTMPVT", "GLL")  # the one that states most first

Parts = dict[str, tuple[str, ...]]


class Place(NamedTuple):
    """A sentence's place; `quality` is None where it states no quality.

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
    """Read latitude and longitude, unless the sentence itself says that they are invalid."""
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
    """Return whether a sentence is one of a receiver that has no position yet, or no more.

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

    RMC and VTG state nothing of up (NaN). At a speed of zero no course is needed.
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
        return 0.0, 0.0, math.nan
    if not course_deg:
        return None
    course_rad = math.radians(read_finite(course_deg))
    return speed_mps * math.sin(course_rad), speed_mps * math.cos(course_rad), math.nan


def _read_altitude_m(place: Place) -> float:
    """Read the altitude over the ellipsoid: that over the sea, and how far the sea is from it."""
    if not place.alt or not place.separation:
        return math.nan
    return read_finite(place.alt) + read_finite(place.separation)
