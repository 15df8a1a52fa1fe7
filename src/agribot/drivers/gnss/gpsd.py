"""Fixes from gpsd, the receiver daemon of Linux: lines of JSON over TCP.

Source: gpsd_json(5), classes TPV and GST, as of gpsd 3.22. It does not state whether the carrier's
ambiguities of a u-blox receiver are fixed; a fix that claims centimetres has them fixed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

import msgspec

from agribot.core.geo import is_nowhere
from agribot.core.messages import GnssFix, GnssQuality
from agribot.drivers.gnss.fix_kinds import DEAD_RECKONING, HELD, make_fields
from agribot.drivers.gnss.nmea import StampedFix
from agribot.drivers.gnss.nmea_places import STD_M

PORT = 2947
LONGEST_LINE = 65536
STATUS = {
    2: GnssQuality.DGNSS,
    3: GnssQuality.RTK_FIXED,
    4: GnssQuality.RTK_FLOAT,
}
UNMEASURED = {5: DEAD_RECKONING, 7: HELD}  # values of its status: dead reckoning, and surveyed in
GST_AGE_S = 2.5  # two epochs of a slow receiver
FIXED_STD_M, FLOAT_STD_M = 0.05, 0.5  # nothing else is so good


def write_watch(device: str = "") -> bytes:
    """Write the request for reports, of one device or of all."""
    wanted = {"enable": True, "json": True} | ({"device": device} if device else {})
    return f"?WATCH={json.dumps(wanted)};\n".encode()


class JsonLineDecoder:
    """Finds JSON objects in a stream of lines; a line without one is counted in `bad`."""

    def __init__(self) -> None:
        self._line = bytearray()
        self.bad = 0

    def feed(self, data: bytes) -> list[dict[str, Any]]:
        *lines, rest = (bytes(self._line) + data).split(b"\n")
        if len(rest) > LONGEST_LINE:
            self.bad += 1
            rest = b""
        self._line = bytearray(rest)
        found = []
        for line in lines:
            if not line.strip():
                continue
            try:
                tree = json.loads(line)
            except (ValueError, RecursionError):
                tree = None
            if isinstance(tree, dict):
                found.append(tree)
            else:
                self.bad += 1
        return found


class GpsdFixes:
    """Makes fixes of TPV, with the accuracy of the last GST where the receiver states one.

    gpsd sends a GST after the position of its epoch, or with it.
    """

    def __init__(self, refuse: Callable[[str], None]) -> None:
        self._refuse = refuse
        self._gst: tuple[float, float] | None = None
        self._last_s = -math.inf
        self.lacks_fix = True  # whether the newest TPV lacks a fix
        self.is_accuracy_known = False  # whether the newest fix has an accuracy

    def add(self, report: Mapping[str, Any]) -> StampedFix | None:
        """Add a report; gives the fix that it is, if it is one."""
        kind = report.get("class")
        try:
            if kind == "GST" and _has_numbers(report, "lat", "lon"):
                std_m = math.hypot(_read(report, "lat", 1e6), _read(report, "lon", 1e6))
                self._gst = _read_time_s(report), std_m / math.sqrt(2.0)
            if kind == "TPV":
                return self._read(report)
        except (KeyError, ValueError, TypeError, OverflowError) as error:
            self._refuse(f"{kind} that cannot be read: {error}")
        return None

    def _read(self, report: Mapping[str, Any]) -> StampedFix | None:
        has_mode = int(report.get("mode", 0)) >= 2
        has_place = _has_numbers(report, "lat", "lon") and not is_nowhere(
            report["lat"], report["lon"]
        )
        self.lacks_fix = not (has_mode and has_place and "time" in report)
        if self.lacks_fix:
            return None
        stamp_s = _read_time_s(report)
        # A second report of one epoch, as it grows; clocks of receivers also step back.
        if stamp_s == self._last_s:
            return None
        std_m, quality = self._judge(report, stamp_s)
        fix = GnssFix(
            t_s=0.0,
            lat_deg=_read(report, "lat", 90.0),
            lon_deg=_read(report, "lon", 180.0),
            alt_m=_read_altitude_m(report),
            pos_std_m=std_m,
            quality=quality,
            velocity_mps=_read_velocity(report),
            velocity_std_mps=max(_read(report, "eps", 1e3), 0.01)
            if _has_numbers(report, "eps")
            else 0.1,
        )
        self._last_s = stamp_s
        kind = UNMEASURED.get(int(report.get("status", 1)))
        return StampedFix(stamp_s, msgspec.structs.replace(fix, **make_fields(kind or quality)))

    def _judge(self, report: Mapping[str, Any], stamp_s: float) -> tuple[float, GnssQuality]:
        quality = STATUS.get(int(report.get("status", 1)), GnssQuality.SINGLE)
        std_m, self.is_accuracy_known = STD_M[quality], True
        if self._gst is not None and abs(self._gst[0] - stamp_s) <= GST_AGE_S:
            std_m = self._gst[1]
        elif _has_numbers(report, "eph"):
            std_m = _read(report, "eph", 1e6) / math.sqrt(2.0)
        else:
            self.is_accuracy_known = False
        std_m = max(std_m, 1e-3)
        if quality is GnssQuality.DGNSS and std_m <= FLOAT_STD_M:
            is_fixed = std_m <= FIXED_STD_M
            quality = GnssQuality.RTK_FIXED if is_fixed else GnssQuality.RTK_FLOAT
        return std_m, quality


def _read_time_s(report: Mapping[str, Any]) -> float:
    return datetime.fromisoformat(str(report["time"])).timestamp()


def _has_numbers(report: Mapping[str, Any], *names: str) -> bool:
    """Whether a report has all of these numbers: what gpsd does not know it leaves out."""
    return all(report.get(name) is not None and not _is_nan(report[name]) for name in names)


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _read_altitude_m(report: Mapping[str, Any]) -> float:
    """Read the altitude above the ellipsoid; NaN where it is not stated.

    gpsd before 3.20 states the one above mean sea level, and how far the geoid is above the
    ellipsoid.
    """
    if _has_numbers(report, "altHAE"):
        return _read(report, "altHAE", 1e5)
    if _has_numbers(report, "altMSL", "geoidSep"):
        return _read(report, "altMSL", 1e5) + _read(report, "geoidSep", 1e3)
    return math.nan


def _read_velocity(report: Mapping[str, Any]) -> tuple[float, float, float] | None:
    """Read East, North and up, NaN without it; None without a speed, or without a course."""
    if _has_numbers(report, "velN", "velE"):
        up_mps = -_read(report, "velD", 1e4) if _has_numbers(report, "velD") else math.nan
        return _read(report, "velE", 1e4), _read(report, "velN", 1e4), up_mps
    if not _has_numbers(report, "speed", "track"):
        return None
    speed_mps, course_rad = _read(report, "speed", 1e4), math.radians(_read(report, "track", 360.0))
    up_mps = _read(report, "climb", 1e4) if _has_numbers(report, "climb") else math.nan
    return speed_mps * math.sin(course_rad), speed_mps * math.cos(course_rad), up_mps


def _read(report: Mapping[str, Any], name: str, limit: float) -> float:
    value = float(report[name])
    if not abs(value) <= limit:
        raise ValueError(f"{name} {value:g} is beyond {limit:g}")
    return value
