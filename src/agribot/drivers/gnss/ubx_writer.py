"""Bytes of a u-blox receiver that there is not: fixes and headings of a simulation as UBX.

Source: as of `ubx`, which reads them: NAV-PVT, NAV-HPPOSLLH and NAV-RELPOSNED.
"""

from __future__ import annotations

import datetime as dt
import math

from agribot.core.geo import compass_deg_from_yaw
from agribot.core.messages import GnssFix, GnssHeading, GnssQuality
from agribot.drivers.gnss import ubx

RUN_BEGINS = dt.datetime(2026, 5, 4, 9, 30, tzinfo=dt.UTC)  # date of a run's time 0; a Monday
GPS_AHEAD_S = 18  # lead over UTC, since 2017
FRAMES_OF_FIX = 2
NS_PER_S, NS_PER_MS = 1_000_000_000, 1_000_000
TIME_ACCURACY_NS = 30
UNKNOWN_DOP = 9999  # 99.99: a simulator without satellites has none
UNKNOWN_ACCURACY = 2**32 - 1
_VALID_TIME = 0b111  # date, time of day, fully resolved
_FIX_3D, _IS_OK, _IS_CORRECTED = 3, 1, 2
_CARRIER = {GnssQuality.RTK_FLOAT: 1 << 6, GnssQuality.RTK_FIXED: 2 << 6}
# Fix good, relative position valid, carrier fixed, base moving, heading valid.
_RELATIVE_FLAGS = 0b1_0011_0101


def write_fix(fix: GnssFix) -> bytes:
    """Write a fix as the messages of its epoch: NAV-PVT, and NAV-HPPOSLLH with its millimetres.

    Empty without a position. A velocity that is not known has an accuracy that says so.
    """
    if fix.quality is GnssQuality.NONE:
        return b""
    at, nano = _find_utc(fix.t_s)
    i_tow_ms = _find_tow_ms(fix.t_s)
    (lat, lat_hp), (lon, lon_hp) = (_split(deg, 1e9, 100) for deg in (fix.lat_deg, fix.lon_deg))
    height_mm, height_hp = _split(fix.alt_m, 1e4, 10)
    h_acc_m = fix.pos_std_m * math.sqrt(2.0)
    east, north, up = (round(v * 1e3) for v in fix.velocity_mps or (0.0, 0.0, 0.0))
    s_acc = UNKNOWN_ACCURACY if fix.velocity_mps is None else round(fix.velocity_std_mps * 1e3)
    flags = _IS_OK | _CARRIER.get(fix.quality, 0)
    if fix.quality is not GnssQuality.SINGLE:
        flags |= _IS_CORRECTED
    course_deg = math.degrees(math.atan2(east, north)) % 360.0
    acc_mm, acc_01mm = round(h_acc_m * 1e3), round(h_acc_m * 1e4)
    pvt = ubx.PVT.pack(
        i_tow_ms, at.year, at.month, at.day, at.hour, at.minute, at.second,
        _VALID_TIME, TIME_ACCURACY_NS, nano,
        _FIX_3D, flags, 0, 0, lon, lat, height_mm, height_mm, acc_mm, 2 * acc_mm,
        north, east, -up, round(math.hypot(north, east)), round(course_deg * 1e5), s_acc,
        18_000_000, UNKNOWN_DOP,
    )  # fmt: skip
    precise = ubx.HPPOSLLH.pack(
        0, 0, i_tow_ms, lon, lat, height_mm, height_mm, lon_hp, lat_hp, height_hp, height_hp,
        acc_01mm, 2 * acc_01mm,
    )  # fmt: skip
    rest = bytes(ubx.PVT_BYTES - len(pvt))
    return ubx.make_frame(ubx.NAV_PVT, pvt + rest) + ubx.make_frame(ubx.NAV_HPPOSLLH, precise)


def write_heading(heading: GnssHeading) -> bytes:
    """Write a heading as NAV-RELPOSNED of a rover antenna ahead of its moving base."""
    heading_deg = compass_deg_from_yaw(heading.yaw_map_rad)
    payload = ubx.RELPOSNED.pack(
        1, _find_tow_ms(heading.t_s), round(heading_deg * 1e5),
        max(round(math.degrees(heading.std_rad) * 1e5), 1), _RELATIVE_FLAGS,
    )  # fmt: skip
    return ubx.make_frame(ubx.NAV_RELPOSNED, payload)


def _split(value: float, per_unit: float, per_coarse: int) -> tuple[int, int]:
    """Split a value into the coarse steps of a field, and the fine ones of its high-precision part.

    As u-blox receivers do, the fine part lies within one coarse step on either side.
    """
    fine = round(value * per_unit)
    coarse = math.trunc(fine / per_coarse)
    return coarse, fine - coarse * per_coarse


def _find_utc(t_s: float) -> tuple[dt.datetime, int]:
    """Find date and whole second of a time of the run, and the nanoseconds after it."""
    seconds, nano = divmod(round(t_s * NS_PER_S), NS_PER_S)
    return RUN_BEGINS + dt.timedelta(seconds=seconds), nano


def _find_tow_ms(t_s: float) -> int:
    """Find the GPS time of the week."""
    days = RUN_BEGINS.isoweekday() % 7
    begin_s = days * 86_400 + RUN_BEGINS.hour * 3600 + RUN_BEGINS.minute * 60 + RUN_BEGINS.second
    ms = (begin_s + GPS_AHEAD_S) * 1000 + round(t_s * NS_PER_S) // NS_PER_MS
    return ms % (7 * 86_400_000)
