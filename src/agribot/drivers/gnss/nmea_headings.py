"""Headings of two antennas in sentences of the standard and of makers.

Sources: NMEA 0183 (HDT, THS); Unicore N4 reference commands manual (HPR); ComNav OEM board
reference manual (TRA, KSXT); Trimble, "NMEA-0183 messages: AVR, VHD"; Septentrio mosaic-X5
reference guide (PSSN,HRP); Quectel LG580P protocol specification (PQTMTAR); Hemisphere GNSS
technical reference (PSAT,HPR); SkyTraq PX1172RH datasheet (PSTI,036); Trimble BX992 and SBG Ellipse
manuals (PASHR).
"""

from __future__ import annotations

from typing import NamedTuple

from agribot.drivers.gnss.nmea import Sentence, read_finite


class _Form(NamedTuple):
    """Where a sentence holds its numbers, and which words in `state` make them a heading."""

    heading: int
    state: int
    good: tuple[str, ...]
    time: int | None = None
    std: int | None = None


_FIXED = ("4",)  # quality by the numbers of GGA
_FORMS = {
    "HDT": _Form(heading=0, state=1, good=("T",)),
    "THS": _Form(heading=0, state=1, good=("A",)),
    # time, heading, pitch, roll, quality
    "HPR": _Form(heading=1, state=4, good=_FIXED, time=0),
    "TRA": _Form(heading=1, state=4, good=_FIXED, time=0),
    # date and time, longitude, latitude, height, heading, pitch, course, speed, roll, 2 qualities
    "KSXT": _Form(heading=4, state=10, good=("3",), time=0),
    # time, yaw, "Yaw", tilt, "Tilt", roll, "Roll", range, quality
    "PTNL,AVR": _Form(heading=2, state=9, good=("3",), time=1),
    # time, date, azimuth, its rate, elevation, its rate, range, its rate, quality
    "PTNL,VHD": _Form(heading=3, state=9, good=("3",), time=1),
    # time, date, heading, roll, pitch, their deviations, count, mode
    "PSSN,HRP": _Form(heading=3, state=10, good=("2",), time=1, std=6),
    # time, heading, pitch, roll, N for one of satellites, G for one of the gyro
    "PSAT,HPR": _Form(heading=2, state=5, good=("N",), time=1),
    # time, date, heading, pitch, roll, mode
    "PSTI,036": _Form(heading=3, state=6, good=("R",), time=1),
    # version, time, quality, -, length, pitch, roll, heading, and three deviations
    "PQTMTAR": _Form(heading=7, state=2, good=_FIXED, time=1, std=10),
    # time, heading, "T", roll, pitch, heave, deviations of roll, pitch and heading, quality
    "PASHR": _Form(heading=1, state=9, good=("1", "2"), time=0, std=8),
}
HEADING_KINDS = frozenset(_FORMS)
# Makers that number their sentences in the first field; others name them there, or not at all.
_NUMBERED = ("PSTI", "PSXN", "PUBX")
_TIME_DIGITS = 6  # hhmmss, behind a date in KSXT


class SentenceHeading(NamedTuple):
    """Degrees clockwise from true North; what the sentence does not state is empty or None."""

    heading_deg: float
    std_deg: float | None = None
    time: str = ""


def name_kind(sentence: Sentence) -> str:
    """Name a sentence, with the word that distinguishes those of one maker, such as PTNL,AVR."""
    kind, word = sentence.kind, sentence.fields[0] if sentence.fields else ""
    is_named = kind.startswith("P") and (word[:1].isalpha() or kind in _NUMBERED)
    return f"{kind},{word}" if is_named else kind


def read_heading(sentence: Sentence) -> SentenceHeading | None:
    """Read the heading; None without one, or if its ambiguities are not fixed.

    Raises: ValueError, IndexError: what stands there is no heading.
    """
    form, fields = _FORMS.get(name_kind(sentence)), sentence.fields
    if form is None or not fields[form.heading] or fields[form.state] not in form.good:
        return None
    heading_deg = read_finite(fields[form.heading])
    # AVR's yaw may be from -180 to 180.
    heading_deg += 360.0 if sentence.kind == "PTNL" and heading_deg < 0.0 else 0.0
    if not 0.0 <= heading_deg <= 360.0:
        raise ValueError(f"{heading_deg:g} is no heading from 0 to 360 degrees")
    std = "" if form.std is None else fields[form.std]
    time = "" if form.time is None else _read_time(fields[form.time])
    return SentenceHeading(heading_deg, read_finite(std) or None if std else None, time)


def _read_time(text: str) -> str:
    whole, dot, part = text.partition(".")
    return whole[-_TIME_DIGITS:] + dot + part
