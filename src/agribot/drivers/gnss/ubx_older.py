"""Fixes of u-blox receivers without NAV-PVT: LEA-4, 5 and 6, and timing receivers as delivered.

Sources: u-blox 6 receiver description (GPS.G6-SW-10018), NAV-SOL, NAV-POSLLH, NAV-VELNED,
NAV-STATUS, NAV-TIMEUTC and NAV-TIMEGPS; those of the fourth generation have the same layout.
"""

from __future__ import annotations

import calendar
import math
import struct
from typing import NamedTuple

import numpy as np

from agribot.core.geo import enu_from_ecef, geodetic_from_ecef, is_place
from agribot.core.messages import GnssFix, GnssQuality, Vec3
from agribot.drivers.gnss.epochs import EpochJoiner
from agribot.drivers.gnss.fix_kinds import DEAD_RECKONING, HELD, FixKind, make_fields
from agribot.drivers.gnss.nmea import StampedFix
from agribot.drivers.gnss.ubx import UbxFrame

NAV_POSLLH, NAV_STATUS, NAV_SOL = (0x01, 0x02), (0x01, 0x03), (0x01, 0x06)
NAV_VELNED, NAV_TIMEGPS, NAV_TIMEUTC = (0x01, 0x12), (0x01, 0x20), (0x01, 0x21)
_SOL = struct.Struct("<IihBBiiiIiiiIH")
_POSLLH = struct.Struct("<IiiiiII")
_VELNED = struct.Struct("<IiiiIIiII")
_STATUS = struct.Struct("<IBB")
_TIMEGPS, _TIMEUTC = struct.Struct("<IihbB"), struct.Struct("<IIiHBBBBBB")
SIZES = {
    NAV_SOL: _SOL.size, NAV_POSLLH: _POSLLH.size, NAV_VELNED: _VELNED.size,
    NAV_STATUS: 16, NAV_TIMEGPS: 16, NAV_TIMEUTC: 20,
}  # fmt: skip
_TIMES = (NAV_TIMEGPS, NAV_TIMEUTC)
_MEASURED = (2, 3, 4)  # gpsFix: 2D, 3D, 3D with dead reckoning
_UNMEASURED: dict[int, FixKind] = {1: DEAD_RECKONING, 5: HELD}
_IS_OK, _IS_DIFFERENTIAL = 1, 2  # flags of NAV-SOL and NAV-STATUS
_GPS_EPOCH_S = calendar.timegm((1980, 1, 6, 0, 0, 0))
_WEEK_S = 604_800.0
_SAME_S = 0.5  # largest gap between two statements of the same time
_LEAST_CM = 1

Parts = dict[tuple[int, int], bytes]


class _Place(NamedTuple):
    lat_deg: float
    lon_deg: float
    alt_m: float
    std_m: float


class OlderFixes:
    """Joins the messages of an epoch, which have the same time of the week, to a fix.

    A place alone does not say whether it is one: NAV-SOL or NAV-STATUS do.
    """

    def __init__(self) -> None:
        self._epochs: EpochJoiner[tuple[int, int]] = EpochJoiner()
        self._offset_s = 1.0  # offset of UTC from the time of the week, once that is known
        self._last_ms = 0
        self.lacks_fix = False  # whether the epoch that the newest frame has completed lacks a fix
        self.is_refused = False  # since the receiver does not call it good

    def add(self, frame: UbxFrame) -> list[StampedFix]:
        """Add a frame; gives the fixes that it completes."""
        kind, payload = frame
        if len(payload) < SIZES.get(kind, 1 << 16):
            return []
        i_tow_ms = int.from_bytes(payload[:4], "little")
        epochs = self._epochs.add(i_tow_ms, kind, payload)
        found = [self._make(*epoch) for epoch in epochs]
        if kind in _TIMES:
            self._set_time(kind, payload)
        self.lacks_fix = None in found and any(_states_fix(parts) for _, parts in epochs)
        return [fix for fix in found if fix is not None]

    def _set_time(self, kind: tuple[int, int], payload: bytes) -> None:
        utc_s = _read_utc_s(payload) if kind == NAV_TIMEUTC else _read_gps_s(payload)
        if utc_s is None:
            return
        offset_s = utc_s - int.from_bytes(payload[:4], "little") * 1e-3
        if abs(offset_s - self._offset_s) > _SAME_S:
            self._offset_s = offset_s

    def _make(self, i_tow_ms: int, parts: Parts) -> StampedFix | None:
        if i_tow_ms < self._last_ms - 500.0 * _WEEK_S:
            self._offset_s += _WEEK_S if self._offset_s < _WEEK_S else 0.0
        self._last_ms = i_tow_ms
        quality, place = self._read_quality(parts), _read_place(parts)
        if quality is None or place is None:
            return None
        velocity_mps, velocity_std_mps = _read_velocity(parts, place)
        fix = GnssFix(
            t_s=0.0, lat_deg=place.lat_deg, lon_deg=place.lon_deg, alt_m=place.alt_m,
            pos_std_m=place.std_m, **make_fields(quality), velocity_mps=velocity_mps,
            velocity_std_mps=velocity_std_mps,
        )  # fmt: skip
        return StampedFix(self._offset_s + i_tow_ms * 1e-3, fix)

    def _read_quality(self, parts: Parts) -> FixKind | None:
        """Read whether there is a fix, and its kind; None without one."""
        if NAV_SOL in parts:
            _, _, _, gps_fix, flags, *_ = _SOL.unpack_from(parts[NAV_SOL])
        elif NAV_STATUS in parts:
            _, gps_fix, flags = _STATUS.unpack_from(parts[NAV_STATUS])
        else:
            return None
        self.is_refused = gps_fix in _MEASURED and not flags & _IS_OK
        if not flags & _IS_OK:
            return None
        if gps_fix in _MEASURED:
            return GnssQuality.DGNSS if flags & _IS_DIFFERENTIAL else GnssQuality.SINGLE
        return _UNMEASURED.get(gps_fix)


def _states_fix(parts: Parts) -> bool:
    return NAV_SOL in parts or {NAV_STATUS, NAV_POSLLH} <= set(parts)


def _read_place(parts: Parts) -> _Place | None:
    """Read NAV-POSLLH, or else NAV-SOL, whose accuracy is that of three axes together."""
    if NAV_POSLLH in parts:
        _, lon, lat, height_mm, _, h_acc_mm, _ = _POSLLH.unpack_from(parts[NAV_POSLLH])
        lat_deg, lon_deg, alt_m, acc_m = lat * 1e-7, lon * 1e-7, height_mm * 1e-3, h_acc_mm * 1e-3
    elif NAV_SOL in parts:
        _, _, _, _, _, x, y, z, acc_cm, *_ = _SOL.unpack_from(parts[NAV_SOL])
        if not x and not y:
            return None
        lat_deg, lon_deg, alt_m = geodetic_from_ecef(np.array((x, y, z)) * 0.01)
        acc_m = acc_cm * 0.01
    else:
        return None
    if not is_place(lat_deg, lon_deg):
        return None
    return _Place(lat_deg, lon_deg, alt_m, max(acc_m, 1e-3) / math.sqrt(2.0))


def _read_velocity(parts: Parts, place: _Place) -> tuple[Vec3 | None, float]:
    """Read East, North and up and their accuracy of NAV-VELNED, or else of NAV-SOL."""
    if NAV_VELNED in parts:
        _, north, east, down, _, _, _, s_acc_cmps, _ = _VELNED.unpack_from(parts[NAV_VELNED])
        velocity_mps = east * 0.01, north * 0.01, -down * 0.01
    elif NAV_SOL in parts:
        *_, vx, vy, vz, s_acc_cmps, _ = _SOL.unpack_from(parts[NAV_SOL])
        turn = enu_from_ecef(place.lat_deg, place.lon_deg)
        east_mps, north_mps, up_mps = turn @ np.array((vx, vy, vz)) * 0.01
        velocity_mps = float(east_mps), float(north_mps), float(up_mps)
    else:
        return None, 0.1
    return velocity_mps, max(s_acc_cmps, _LEAST_CM) * 0.01


def _read_utc_s(payload: bytes) -> float | None:
    """Read NAV-TIMEUTC; None while its leap seconds are not known."""
    _, _, nano, year, month, day, hour, minute, second, valid = _TIMEUTC.unpack_from(payload)
    if not valid & 4 or not (1980 <= year < 2500 and 1 <= month <= 12):
        return None
    return float(calendar.timegm((year, month, day, hour, minute, second)) + nano * 1e-9)


def _read_gps_s(payload: bytes) -> float | None:
    """Read NAV-TIMEGPS as UTC; None while week, time or leap seconds are not known."""
    i_tow_ms, f_tow_ns, week, leap_s, valid = _TIMEGPS.unpack_from(payload[:12])
    if valid & 7 != 7:
        return None
    return float(_GPS_EPOCH_S + week * _WEEK_S + i_tow_ms * 1e-3 + f_tow_ns * 1e-9 - leap_s)
