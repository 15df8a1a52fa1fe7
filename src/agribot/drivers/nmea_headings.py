"""Headings of two antennas in sentences: HDT, THS, HPR, PTNL,AVR, PSSN,HRP and PQTMTAR.

Sources: NMEA 0183 (HDT, THS); Unicore N4 reference commands manual (HPR); Trimble, "NMEA-0183
message: AVR"; Septentrio mosaic-X5 reference guide (PSSN,HRP); Quectel LG580P protocol
specification (PQTMTAR).
"""

from __future__ import annotations

from typing import NamedTuple

from agribot.drivers.nmea import Sentence, read_finite

_FIXED = "4"  # by the numbers of GGA, which HPR and PQTMTAR share
_AVR_FIXED = "3"
_HRP_FIXED = "2"  # heading and pitch of antennas with fixed ambiguities
HEADING_KINDS = ("HDT", "THS", "HPR", "PTNL", "PSSN", "PQTMTAR")


class SentenceHeading(NamedTuple):
    """Degrees clockwise from true North; what the sentence does not state is empty or None."""

    heading_deg: float
    std_deg: float | None = None
    time: str = ""


def is_about_heading(sentence: Sentence) -> bool:
    """Return whether it is a sentence that this file reads."""
    kind, fields = sentence.kind, sentence.fields
    if kind == "PTNL":
        return fields[:1] == ("AVR",)
    return kind in HEADING_KINDS if kind != "PSSN" else fields[:1] == ("HRP",)


def read_heading(sentence: Sentence) -> SentenceHeading | None:
    """Read the heading; None without one, or if its ambiguities are not fixed.

    Raises: ValueError, IndexError: what stands there is no heading.
    """
    found = _read(sentence.kind, sentence.fields) if is_about_heading(sentence) else None
    if found is not None and not 0.0 <= found.heading_deg <= 360.0:
        raise ValueError(f"{found.heading_deg:g} is no heading from 0 to 360 degrees")
    return found


def _read(kind: str, fields: tuple[str, ...]) -> SentenceHeading | None:
    if kind == "HDT":
        return _read_hdt(fields)
    if kind == "THS":
        return SentenceHeading(read_finite(fields[0])) if fields[0] and fields[1] == "A" else None
    heading, std, time, is_fixed = _find(kind, fields)
    if not is_fixed or not heading:
        return None
    heading_deg = read_finite(heading)
    # AVR's yaw may be from -180 to 180.
    heading_deg += 360.0 if kind == "PTNL" and heading_deg < 0.0 else 0.0
    return SentenceHeading(heading_deg, read_finite(std) or None if std else None, time)


def _find(kind: str, fields: tuple[str, ...]) -> tuple[str, str, str, bool]:
    """Find heading, its deviation and time, and whether its ambiguities are fixed."""
    if kind == "HPR":  # time, heading, pitch, roll, quality
        return fields[1], "", fields[0], fields[4] == _FIXED
    if kind == "PTNL":  # AVR, time, yaw, "Yaw", tilt, "Tilt", roll, "Roll", range, quality
        return fields[2], "", fields[1], fields[9] == _AVR_FIXED
    if kind == "PSSN":  # HRP, time, date, heading, roll, pitch, their deviations, count, mode
        return fields[3], fields[6], fields[1], fields[10] == _HRP_FIXED
    # PQTMTAR: version, time, quality, -, length, pitch, roll, heading, and three deviations
    return fields[7], fields[10], fields[1], fields[2] == _FIXED


def _read_hdt(fields: tuple[str, ...]) -> SentenceHeading | None:
    if not fields or not fields[0]:
        return None
    heading_deg = read_finite(fields[0])
    if fields[1:2] != ("T",):
        raise ValueError(f"{','.join(fields)} is no true heading")
    return SentenceHeading(heading_deg)
