"""NMEA 0183 of a GNSS receiver: bytes to sentences, sentences to one fix an epoch and a heading.

Sources: NMEA 0183; the sentences GGA, RMC, GST and HDT as the u-blox interface description and
gpsd's "NMEA Revealed" give them. GSV and GSA are in `sky.py`.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable
from typing import NamedTuple

from agribot.core.messages import GnssFix, GnssQuality

LONGEST_LINE = 256  # 82 by the standard; some receivers say more
KNOT_MPS = 1852.0 / 3600.0
DAY_S = 86400.0
# 1 sigma of one horizontal axis where no GST tells it, at an HDOP of 1.
STD_M = {
    GnssQuality.SINGLE: 2.5,
    GnssQuality.DGNSS: 1.0,
    GnssQuality.RTK_FLOAT: 0.3,
    GnssQuality.RTK_FIXED: 0.02,
}
QUALITY = {
    1: GnssQuality.SINGLE,
    2: GnssQuality.DGNSS,
    3: GnssQuality.SINGLE,  # PPS
    4: GnssQuality.RTK_FIXED,
    5: GnssQuality.RTK_FLOAT,
}


class StampedFix(NamedTuple):
    """A fix and the receiver's own time of it, whose zero is anywhere."""

    stamp_s: float
    fix: GnssFix


class Sentence(NamedTuple):
    """`kind` is what follows the talker, such as GGA; `fields` come after it."""

    kind: str
    fields: tuple[str, ...]
    talker: str = ""


class SentenceDecoder:
    """Finds sentences in a stream of bytes; what is broken is counted in `bad` and left out."""

    def __init__(self) -> None:
        self._line = bytearray()
        self._is_in_line = False
        self.bad = 0

    def feed(self, data: bytes) -> list[Sentence]:
        found = []
        for byte in data:
            if byte == ord("$"):
                self._line.clear()
                self._is_in_line = True
            elif not self._is_in_line:
                continue
            elif byte in b"\r\n":
                self._is_in_line = False
                sentence = read_sentence(bytes(self._line))
                self.bad += sentence is None
                found += [sentence] if sentence else []
            elif len(self._line) >= LONGEST_LINE:
                self._is_in_line = False
                self.bad += 1
            else:
                self._line.append(byte)
        return found


def read_sentence(line: bytes) -> Sentence | None:
    """Read what stands between $ and the line's end; None where the checksum is wrong."""
    body, star, told = line.partition(b"*")
    checksum = functools.reduce(operator.xor, body, 0)
    if not star or told.upper() != b"%02X" % checksum:
        return None
    words = body.decode("ascii", "replace").split(",")
    head, fields = words[0], tuple(words[1:])
    return Sentence(head[2:], fields, head[:2]) if len(head) >= 5 else Sentence(head, fields)


def write_sentence(body: str) -> bytes:
    """Put a body of printable ASCII between $ and its checksum."""
    checksum = functools.reduce(operator.xor, body.encode(), 0)
    return f"${body}*{checksum:02X}\r\n".encode()


class NmeaFixes:
    """Joins the sentences of an epoch to a fix.

    An epoch ends with the kind of sentence that ended the one before it, so that a fix waits for
    no other, or else where the next one begins.
    """

    def __init__(self, refuse: Callable[[str], None]) -> None:
        self._refuse = refuse
        self._time_of_day_s = math.nan
        self._days_s = 0.0
        self._parts: dict[str, tuple[str, ...]] = {}
        self._last_kind, self._ending_kind = "", ""
        self._is_told = True

    def add(self, sentence: Sentence) -> StampedFix | None:
        """Add a sentence; gives the fix that it completes."""
        kind = sentence.kind
        place = {"GGA": 0, "RMC": 0, "GST": 0}.get(kind)
        if place is None or not sentence.fields or not sentence.fields[place]:
            return None
        try:
            time_of_day_s = _read_time_of_day(sentence.fields[place])
        except ValueError:
            self._refuse(f"{kind} with the time {sentence.fields[place]!r}")
            return None
        finished = None
        if time_of_day_s != self._time_of_day_s:
            self._ending_kind = self._last_kind
            finished = None if self._is_told else self._make()
            self._begin(time_of_day_s)
        self._parts[kind] = sentence.fields
        self._last_kind = kind
        if kind == self._ending_kind and not self._is_told:
            return self._make() or finished
        return finished

    @property
    def stamp_s(self) -> float:
        """Of the epoch that its sentences tell of now; 0 before the first."""
        is_known = math.isfinite(self._time_of_day_s)
        # Not zero at midnight, which would count as none.
        return self._days_s + self._time_of_day_s + DAY_S if is_known else 0.0

    def _begin(self, time_of_day_s: float) -> None:
        if time_of_day_s < self._time_of_day_s - DAY_S / 2.0:
            self._days_s += DAY_S
        self._time_of_day_s, self._parts, self._is_told = time_of_day_s, {}, False

    def _make(self) -> StampedFix | None:
        self._is_told = True
        if "GGA" not in self._parts:
            return None
        try:
            fix = make_fix(self._parts)
        except (ValueError, IndexError) as error:
            self._refuse(f"a fix that cannot be read: {error}")
            return None
        return StampedFix(self.stamp_s, fix) if fix else None


def make_fix(parts: dict[str, tuple[str, ...]]) -> GnssFix | None:
    """Make a fix of the fields of one epoch by kind; None while the receiver has no position.

    Raises: ValueError, IndexError: fields that are no numbers, out of range, or missing.
    """
    _, lat, north, lon, east, quality_text, _, hdop, alt, _, separation, *_ = parts["GGA"]
    quality = QUALITY.get(int(quality_text or "0"), GnssQuality.NONE)
    if quality is GnssQuality.NONE or not _has_place(lat, lon):
        return None
    velocity_mps = _read_velocity(parts["RMC"]) if "RMC" in parts else None
    return GnssFix(
        t_s=0.0,
        lat_deg=_read_degrees(lat, north, "NS", 90.0),
        lon_deg=_read_degrees(lon, east, "EW", 180.0),
        alt_m=_read_finite(alt or "0") + _read_finite(separation or "0"),
        pos_std_m=_read_std_m(parts, quality, hdop),
        quality=quality,
        velocity_mps=velocity_mps,
    )


def lacks_fix(sentence: Sentence) -> bool:
    """Tell whether a sentence is a GGA of a receiver that has no position yet, or no more.

    Raises: ValueError, IndexError: a quality that is no number, or too few fields.
    """
    if sentence.kind != "GGA":
        return False
    _, lat, _, lon, _, quality_text, *_ = sentence.fields
    return int(quality_text or "0") not in QUALITY or not _has_place(lat, lon)


def _has_place(lat: str, lon: str) -> bool:
    """Tell whether a place stands there: neither nothing nor 0, 0, whatever the quality."""
    return bool(lat and lon and (lat.strip("0.") or lon.strip("0.")))


def read_heading_deg(sentence: Sentence) -> float | None:
    """Read HDT: degrees clockwise from true North; None where it tells none.

    Raises: ValueError: what stands there is no heading.
    """
    if sentence.kind != "HDT" or not sentence.fields or not sentence.fields[0]:
        return None
    heading_deg = _read_finite(sentence.fields[0])
    if sentence.fields[1:2] != ("T",) or not 0.0 <= heading_deg <= 360.0:
        raise ValueError(f"{','.join(sentence.fields)} is no true heading")
    return heading_deg


def write_gga(found: StampedFix, satellites: int = 12) -> bytes:
    """Write a fix as GGA, for a service that wants to know where its rover is.

    Its altitude is that over the ellipsoid, with a geoid separation of zero.
    """
    stamp_s, fix = found
    hours, rest_s = divmod(stamp_s % DAY_S, 3600.0)
    minutes, seconds = divmod(rest_s, 60.0)
    time = f"{int(hours):02d}{int(minutes):02d}{math.floor(seconds * 100.0) / 100.0:05.2f}"
    lat = f"{_write_degrees(fix.lat_deg, 2)},{'N' if fix.lat_deg >= 0.0 else 'S'}"
    lon = f"{_write_degrees(fix.lon_deg, 3)},{'E' if fix.lon_deg >= 0.0 else 'W'}"
    body = f"{fix.quality:d},{satellites:02d},1.0,{fix.alt_m:.3f},M,0.0,M,,"
    return write_sentence(f"GPGGA,{time},{lat},{lon},{body}")


def _write_degrees(angle_deg: float, digits: int) -> str:
    units = round(abs(angle_deg) * 60e7)  # of 1e-7 minutes, so that 60 of these never stand there
    degrees, minutes = divmod(units, 600_000_000)
    return f"{degrees:0{digits}d}{minutes // 10_000_000:02d}.{minutes % 10_000_000:07d}"


def _read_std_m(parts: dict[str, tuple[str, ...]], quality: GnssQuality, hdop: str) -> float:
    told = parts.get("GST", ())[5:7]
    if len(told) == 2 and all(told):
        std_m = math.hypot(*map(_read_finite, told)) / math.sqrt(2.0)
        if std_m > 0.0:
            return std_m
    return STD_M[quality] * max(1.0, _read_finite(hdop or "1"))


def _read_velocity(fields: tuple[str, ...]) -> tuple[float, float, float] | None:
    """Read East, North and up of RMC; a receiver at rest may leave out the course."""
    if fields[1] != "A" or not fields[6]:
        return None
    speed_mps = KNOT_MPS * _read_finite(fields[6])
    course_rad = math.radians(_read_finite(fields[7] or "0"))
    return speed_mps * math.sin(course_rad), speed_mps * math.cos(course_rad), 0.0


def _read_time_of_day(text: str) -> float:
    hours, minutes, seconds = int(text[:2]), int(text[2:4]), float(text[4:])
    if not (0 <= hours < 24 and 0 <= minutes < 60 and 0.0 <= seconds < 61.0):
        raise ValueError(f"{text} is no time of day")
    return 3600.0 * hours + 60.0 * minutes + seconds


def _read_degrees(text: str, side: str, sides: str, limit_deg: float) -> float:
    """Read degrees and minutes in one number, ddmm.mmmm."""
    value = _read_finite(text)
    degrees = math.floor(value / 100.0)
    minutes = value - 100.0 * degrees
    angle_deg = degrees + minutes / 60.0
    if not (0.0 <= minutes < 60.0 and 0.0 <= angle_deg <= limit_deg) or side not in tuple(sides):
        raise ValueError(f"{text} {side} is no angle up to {limit_deg:g} degrees {sides}")
    return angle_deg if side == sides[0] else -angle_deg


def _read_finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not finite")
    return value
