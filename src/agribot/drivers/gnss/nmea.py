"""NMEA 0183 of a GNSS receiver: bytes to sentences, and GGA for a caster.

Source: NMEA 0183. `nmea_fixes.py` and `nmea_places.py` make fixes of sentences, `nmea_headings.py`
headings, and `sky.py` reads GSV and GSA.
"""

from __future__ import annotations

import functools
import math
import operator
import re
from typing import NamedTuple

from agribot.core.messages import GnssFix

LONGEST_LINE = 256  # 82 by the standard; some receivers say more
KNOT_MPS = 1852.0 / 3600.0
DAY_S = 86400.0
BARE_SENTENCES = 5  # sentences without a checksum before a stream counts as one that has none
_PARTS = re.compile(rb"[$\r\n]|[^$\r\n]+")
_BARE_HEAD = re.compile(rb"[A-Z]{5,9},[ -~]*\Z")


class StampedFix(NamedTuple):
    """A fix and the receiver's own time of it, whose zero is anywhere."""

    stamp_s: float
    fix: GnssFix


class Sentence(NamedTuple):
    """`kind` is what follows the talker, such as GGA; `fields` come after it.

    A proprietary sentence has no talker: its kind is the whole address, such as PQTMTAR.
    """

    kind: str
    fields: tuple[str, ...]
    talker: str = ""


class SentenceDecoder:
    """Finds sentences in a stream of bytes; what is broken is counted in `bad` and left out.

    Sentences without a checksum are taken where the stream has no other ones: the first of them
    wait until there are enough.
    """

    def __init__(self) -> None:
        self._line = bytearray()
        self._is_in_line = False
        self._has_checksums = False
        self._bare = 0  # sentences without a checksum
        self._held: list[Sentence] = []  # bare sentences, until there are enough
        self.bad = 0

    def feed(self, data: bytes) -> list[Sentence]:
        found = []
        for part in _PARTS.findall(data):
            if part == b"$":
                self._line.clear()
                self._is_in_line = True
            elif not self._is_in_line:
                continue
            elif part in b"\r\n":
                self._is_in_line = False
                found += self._read(bytes(self._line))
            elif len(self._line) + len(part) > LONGEST_LINE:
                self._is_in_line = False
                self.bad += 1
            else:
                self._line += part
        return found

    def _read(self, line: bytes) -> list[Sentence]:
        sentence = read_sentence(line)
        if sentence is not None:
            self._has_checksums = True
            return [sentence]
        if b"*" in line or self._has_checksums or not _BARE_HEAD.match(line):
            self.bad += 1
            return []
        self._bare += 1
        self._held.append(_split(line))
        if self._bare < BARE_SENTENCES:
            return []
        found, self._held = self._held, []
        return found


def read_sentence(line: bytes) -> Sentence | None:
    """Read what stands between $ and the line's end; None where the checksum is wrong."""
    body, star, checksum = line.partition(b"*")
    is_right = checksum.strip().upper() == b"%02X" % functools.reduce(operator.xor, body, 0)
    return _split(body) if star and is_right else None


def _split(body: bytes) -> Sentence:
    words = body.decode("ascii", "replace").split(",")
    head, fields = words[0], tuple(words[1:])
    if head.startswith("P") or len(head) < 5:
        return Sentence(head, fields)
    return Sentence(head[2:], fields, head[:2])


def write_sentence(body: str) -> bytes:
    """Put a body of printable ASCII between $ and its checksum."""
    checksum = functools.reduce(operator.xor, body.encode(), 0)
    return f"${body}*{checksum:02X}\r\n".encode()


def write_gga(found: StampedFix, satellites: int = 12) -> bytes:
    """Write a fix as GGA, for a service that wants to know where its rover is.

    Its altitude is that over the ellipsoid, with a geoid separation of zero; empty if unknown.
    """
    stamp_s, fix = found
    hours, rest_s = divmod(stamp_s % DAY_S, 3600.0)
    minutes, seconds = divmod(rest_s, 60.0)
    time = f"{int(hours):02d}{int(minutes):02d}{math.floor(seconds * 100.0) / 100.0:05.2f}"
    lat = f"{_write_degrees(fix.lat_deg, 2)},{'N' if fix.lat_deg >= 0.0 else 'S'}"
    lon = f"{_write_degrees(fix.lon_deg, 3)},{'E' if fix.lon_deg >= 0.0 else 'W'}"
    alt = f"{fix.alt_m:.3f}" if math.isfinite(fix.alt_m) else ""
    body = f"{fix.quality:d},{satellites:02d},1.0,{alt},M,0.0,M,,"
    return write_sentence(f"GPGGA,{time},{lat},{lon},{body}")


def _write_degrees(angle_deg: float, digits: int) -> str:
    units = round(abs(angle_deg) * 60e7)  # units of 1e-7 minutes, so that 60 never stands there
    degrees, minutes = divmod(units, 600_000_000)
    return f"{degrees:0{digits}d}{minutes // 10_000_000:02d}.{minutes % 10_000_000:07d}"


def read_time_of_day_s(text: str) -> float:
    """Read hhmmss.ss. Raises: ValueError: it is no time of day."""
    hours, minutes, seconds = int(text[:2]), int(text[2:4]), float(text[4:])
    if not (0 <= hours < 24 and 0 <= minutes < 60 and 0.0 <= seconds < 61.0):
        raise ValueError(f"{text} is no time of day")
    return 3600.0 * hours + 60.0 * minutes + seconds


def read_degrees(text: str, side: str, sides: str, limit_deg: float) -> float:
    """Read degrees and minutes in one number, ddmm.mmmm. Raises: ValueError: it is no angle."""
    value = read_finite(text)
    degrees = math.floor(value / 100.0)
    minutes = value - 100.0 * degrees
    angle_deg = degrees + minutes / 60.0
    if not (0.0 <= minutes < 60.0 and 0.0 <= angle_deg <= limit_deg) or side not in tuple(sides):
        raise ValueError(f"{text} {side} is no angle up to {limit_deg:g} degrees {sides}")
    return angle_deg if side == sides[0] else -angle_deg


def read_finite(text: str) -> float:
    """Read a number. Raises: ValueError: not a number, or not finite."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not finite")
    return value
