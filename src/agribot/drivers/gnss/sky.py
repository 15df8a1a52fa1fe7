"""What a receiver sees of the sky: satellites, dilutions of precision, the corrections' age.

Sources: NMEA 0183 (GSV, GSA, GGA); UBXDOC-963802114-12815 (NAV-SAT, NAV-DOP, NAV-PVT, RXM-RTCM,
RXM-COR); gpsd_json(5), class SKY.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any

from agribot.core.messages import GnssStatus, Satellite
from agribot.drivers.gnss.corrections import CorrectionState
from agribot.drivers.gnss.heard import Heard
from agribot.drivers.gnss.nmea import Sentence
from agribot.drivers.gnss.ubx import NAV_PVT, UbxFrame

PERIOD_S = 1.0  # period of a status
_JITTER_S = 0.2  # jitter of arrivals, which stand for the period where no fix has a stamp
NAV_DOP, NAV_SAT = (0x01, 0x04), (0x01, 0x35)
RXM_RTCM, RXM_COR = (0x02, 0x32), (0x02, 0x34)
_DOP = struct.Struct("<I7H")
_SAT_HEAD, _SAT = struct.Struct("<IBB2x"), struct.Struct("<BBBbhhI")
_PVT_PDOP, _PVT_FLAGS3 = 76, 78
_UBX_SYSTEMS = {0: "GP", 1: "SB", 2: "GA", 3: "GB", 5: "GQ", 6: "GL"}
_NMEA_SYSTEMS = {"1": "GP", "2": "GL", "3": "GA", "4": "GB", "5": "GQ"}
_SBAS_NUMBERS = range(33, 65)  # numbers in NMEA, among those of GPS
_GLONASS_NUMBERS = range(65, 97)
# Upper limits of the age by NAV-PVT's lastCorrectionAge; 12 and more are older.
_AGE_LIMITS_S = (None, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0)
_OLDEST_S = 300.0
_MOST_SATELLITES = 200
_MOST_NUMBER = 999  # largest number of a satellite: three digits, in NMEA and in gpsd
_DOP_NAMES = ("gdop", "pdop", "hdop", "vdop", "tdop")
_COR_BYTES, _RTCM_BYTES = 12, 8
_IS_RTCM3 = 1  # value of RXM-COR's protocol
_UNUSED, _USED = 1, 2  # values of msgUsed; 0 is unknown
_UNKNOWN_DOP = 99.9  # value that receivers write without a fix

Key = tuple[str, int]


class Sky:
    """Gathers what reports state beside positions, and makes a status of it once a second.

    `corrections` gives the state of a caster's, where one feeds the receiver.
    """

    def __init__(self, heard: Heard | None = None) -> None:
        self._heard = heard or Heard()
        self.corrections: Callable[[], CorrectionState] | None = None
        self._groups: dict[tuple[str, str], list[Satellite]] = {}
        self._seen: dict[tuple[str, str], list[Satellite]] = {}
        self._used: set[Key] = set()
        self._dops: dict[str, float] = {}
        self._age_s: float | None = None
        self._use = CorrectionUse()
        self._last_s = self._last_arrived_s = -math.inf

    def make_status(self, stamp_s: float, arrived_s: float) -> GnssStatus | None:
        """Make the status of an epoch; None before a second has passed, or without anything.

        `stamp_s` is the receiver's time of its fix. It is 0 without a fix: the time of arrival, on
        a clock of ours, counts then.
        """
        if self._is_early(stamp_s, arrived_s):
            return None
        state = self.corrections() if self.corrections else CorrectionState(self._age_s, {})
        satellites = self._join_satellites()
        trouble = "" if self._heard.is_patient(arrived_s) else self._heard.explain()
        is_known = satellites or self._dops or self.corrections or self._age_s is not None
        unread = self._heard.name_unread()
        if not (is_known or trouble or unread):
            return None
        status = GnssStatus(
            t_s=0.0,
            satellites=satellites,
            correction_age_s=state.age_s,
            correction_counts=tuple(sorted(state.counts.items())),
            corrections_used=self._use.used,
            corrections_unused=self._use.unused,
            unread=unread,
            trouble=trouble,
            **self._dops,
        )
        self._last_s, self._last_arrived_s = stamp_s or self._last_s, arrived_s
        self._used, self._dops, self._age_s = set(), {}, None
        return status

    def add_sentence(self, sentence: Sentence) -> None:
        """Add an NMEA sentence.

        Raises: ValueError, IndexError: fields that are no numbers, or too few.
        """
        if sentence.kind == "GSV":
            self._add_gsv(sentence)
        elif sentence.kind == "GSA":
            self._add_gsa(sentence)
        elif sentence.kind == "GGA" and sentence.fields[12]:
            self._age_s = _read_number(sentence.fields[12], 0.0, 1e5)

    def add_frame(self, frame: UbxFrame) -> None:
        """Add a frame of UBX; what is too short is left out."""
        kind, payload = frame
        self._use.add(frame)
        if kind == NAV_PVT and len(payload) >= _PVT_FLAGS3 + 2:
            self._note_dop("pdop", int.from_bytes(payload[_PVT_PDOP:_PVT_FLAGS3], "little") * 0.01)
            place = payload[_PVT_FLAGS3] >> 1 & 0xF
            self._age_s = _AGE_LIMITS_S[place] if place < len(_AGE_LIMITS_S) else _OLDEST_S
        elif kind == NAV_DOP and len(payload) >= _DOP.size:
            _, gdop, pdop, tdop, vdop, hdop, _, _ = _DOP.unpack_from(payload)
            for name, value in zip(_DOP_NAMES, (gdop, pdop, hdop, vdop, tdop), strict=True):
                self._note_dop(name, value * 0.01)
        elif kind == NAV_SAT and len(payload) >= _SAT_HEAD.size:
            count = min(_SAT_HEAD.unpack_from(payload)[2], (len(payload) - 8) // _SAT.size)
            self._seen = {("", ""): [_read_ubx_satellite(payload, k) for k in range(count)]}

    def add_sky(self, report: Mapping[str, Any]) -> None:
        """Add a SKY of gpsd, which states satellites, dilutions, or both.

        Raises: ValueError, TypeError, KeyError, OverflowError: not a SKY.
        """
        for name in _DOP_NAMES:
            if name in report:
                self._note_dop(name, float(report[name]))
        report_part = report.get("satellites")
        if report_part is not None:
            self._seen = {
                ("", ""): [_read_gpsd_satellite(s) for s in report_part[:_MOST_SATELLITES]]
            }

    def _is_early(self, stamp_s: float, arrived_s: float) -> bool:
        if stamp_s:
            return 0.0 <= stamp_s - self._last_s < PERIOD_S
        return arrived_s - self._last_arrived_s < PERIOD_S - _JITTER_S

    def _note_dop(self, name: str, value: float) -> None:
        if 0.0 < value < _UNKNOWN_DOP:
            self._dops[name] = value

    def _add_gsv(self, sentence: Sentence) -> None:
        """Gather one of the sentences about the satellites of a system, signal by signal."""
        total, number, _, *rest = sentence.fields
        key = sentence.talker, rest.pop() if len(rest) % 4 == 1 else ""
        group = self._groups.setdefault(key, [])
        if number == "1":
            group.clear()
        for k in range(0, len(rest) - 3, 4):
            if rest[k] and rest[k + 1] and rest[k + 2] and len(group) < _MOST_SATELLITES:
                group.append(_read_gsv_satellite(sentence.talker, *rest[k : k + 4]))
        if number == total:
            self._seen[key] = self._groups.pop(key)

    def _add_gsa(self, sentence: Sentence) -> None:
        numbers = [int(text) for text in sentence.fields[2:14] if text]
        pdop, hdop, vdop, *system = sentence.fields[14:]
        for name, text in (("pdop", pdop), ("hdop", hdop), ("vdop", vdop)):
            if text:
                self._note_dop(name, _read_number(text, 0.0, 1e3))
        report_part = _NMEA_SYSTEMS.get(system[0], "") if system else ""
        self._used |= {(report_part or _guess_system(sentence.talker, n), n) for n in numbers}

    def _join_satellites(self) -> tuple[Satellite, ...]:
        """Join signals: a satellite is as strong as its best; what GSA names is used."""
        found: dict[Key, Satellite] = {}
        for satellite in (each for group in self._seen.values() for each in group):
            key = satellite.system, satellite.number
            known = found.get(key)
            if known is None or known.snr_db < satellite.snr_db:
                found[key] = satellite
        return tuple(
            _mark_used(each) if key in self._used else each
            for key, each in sorted(found.items())[:_MOST_SATELLITES]
        )


class CorrectionUse:
    """Counts the corrections that a receiver says to have used, and those that it has not.

    A newer receiver reports each twice, in RXM-RTCM and in RXM-COR: the latter counts then. Both
    are None before its first report.
    """

    def __init__(self) -> None:
        self.used: int | None = None
        self.unused: int | None = None
        self._has_cor = False

    def add(self, frame: UbxFrame) -> None:
        """Add a frame of UBX; other kinds are left out."""
        kind, payload = frame
        if kind == RXM_COR and len(payload) >= _COR_BYTES:
            self._begin_cor()
            info = int.from_bytes(payload[4:8], "little")
            if info & 0x1F == _IS_RTCM3:
                self._count(info >> 7 & 3)
        elif kind == RXM_RTCM and len(payload) >= _RTCM_BYTES and not self._has_cor:
            is_broken = payload[1] & 1
            self._count(_UNUSED if is_broken else payload[1] >> 1 & 3)

    def _begin_cor(self) -> None:
        if not self._has_cor:
            self._has_cor, self.used, self.unused = True, None, None

    def _count(self, use: int) -> None:
        if use in (_UNUSED, _USED):
            self.used = (self.used or 0) + (use == _USED)
            self.unused = (self.unused or 0) + (use == _UNUSED)


def _mark_used(satellite: Satellite) -> Satellite:
    return Satellite(
        system=satellite.system, number=satellite.number, elevation_deg=satellite.elevation_deg,
        azimuth_deg=satellite.azimuth_deg, snr_db=satellite.snr_db, is_used=True,
    )  # fmt: skip


def _guess_system(talker: str, number: int) -> str:
    """Guess whose number it is, by NMEA's ranges where the talker is GN."""
    if talker in ("GP", "GN") and number in _SBAS_NUMBERS:
        return "SB"
    if talker == "GN":
        return "GL" if number in _GLONASS_NUMBERS else "GP"
    return "GB" if talker == "BD" else talker


def _read_gsv_satellite(
    talker: str, number: str, elevation: str, azimuth: str, snr: str
) -> Satellite:
    return Satellite(
        system=_guess_system(talker, _read_satellite(number)),
        number=_read_satellite(number),
        elevation_deg=_read_number(elevation, -90.0, 90.0),
        azimuth_deg=_read_number(azimuth, 0.0, 360.0),
        snr_db=_read_number(snr or "0", 0.0, 99.0),
        is_used=False,
    )


def _read_ubx_satellite(payload: bytes, index: int) -> Satellite:
    system, number, snr, elevation, azimuth, _, flags = _SAT.unpack_from(
        payload, _SAT_HEAD.size + index * _SAT.size
    )
    return Satellite(
        system=_UBX_SYSTEMS.get(system, "?"), number=number, elevation_deg=float(elevation),
        azimuth_deg=float(azimuth), snr_db=float(snr), is_used=bool(flags & 8),
    )  # fmt: skip


def _read_gpsd_satellite(report_part: Mapping[str, Any]) -> Satellite:
    return Satellite(
        system=_UBX_SYSTEMS.get(int(report_part.get("gnssid", 0)), "?"),
        number=_read_satellite(report_part["PRN"]),
        elevation_deg=_read_number(report_part.get("el", 0.0), -90.0, 90.0),
        azimuth_deg=_read_number(report_part.get("az", 0.0), 0.0, 360.0),
        snr_db=_read_number(report_part.get("ss", 0.0), 0.0, 99.0),
        is_used=bool(report_part.get("used", False)),
    )


def _read_satellite(number: str | float) -> int:
    return int(_read_number(number, 0.0, _MOST_NUMBER))


def _read_number(text: str | float, least: float, most: float) -> float:
    value = float(text)
    if not least <= value <= most:
        raise ValueError(f"{text} is not from {least:g} to {most:g}")
    return value
