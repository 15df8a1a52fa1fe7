"""UBX of u-blox receivers: bytes to frames, frames to fixes with their stated accuracy.

Source: u-blox F9 HPG 1.32 interface description (UBXDOC-963802114-12815), NAV-PVT,
NAV-HPPOSLLH and NAV-RELPOSNED; older receivers (M8) send the same NAV-PVT.
"""

from __future__ import annotations

import calendar
import math
import struct
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.core.geo import is_place
from agribot.core.messages import GnssFix, GnssQuality
from agribot.drivers.gnss.fix_kinds import DEAD_RECKONING, HELD, FixKind, make_fields
from agribot.drivers.gnss.nmea import StampedFix

SYNC = b"\xb5\x62"
LONGEST_PAYLOAD = 8192
_INNER_TRIES = 4  # beginnings of frames within one that does not end
NAV_PVT, NAV_HPPOSLLH, NAV_RELPOSNED = (0x01, 0x07), (0x01, 0x14), (0x01, 0x3C)
PVT = struct.Struct("<IHBBBBBBIiBBBBiiiiIIiiiiiIIH")
PVT_BYTES = 92  # size from a receiver that sends all fields
HPPOSLLH = struct.Struct("<BxxBIiiiibbbbII")
RELPOSNED = struct.Struct("<B3xI16xi24xI4xI")
# Values of NAV-PVT: by dead reckoning alone, 2D, 3D, 3D with dead reckoning, and time only.
FIX_TYPES = (1, 2, 3, 4, 5)
_UNMEASURED: dict[int, FixKind] = {1: DEAD_RECKONING, 5: HELD}
_CARRIER = {1: GnssQuality.RTK_FLOAT, 2: GnssQuality.RTK_FIXED}
# Flags of NAV-RELPOSNED: fix good, relative position valid, carrier fixed, base moving, heading
# valid.
_HAS_HEADING, _HEADING_MASK = 0b1_0011_0101, 0b1_0011_1101
_YEARS = range(1980, 2500)
_KNOWS_TIME = 0b11  # flags of NAV-PVT: date and time of day are valid


class UbxFrame(NamedTuple):
    """`kind` is class and id."""

    kind: tuple[int, int]
    payload: bytes


class UbxDecoder:
    """Finds frames in a stream of bytes; what is broken is counted in `bad` and left out."""

    def __init__(self) -> None:
        self._waiting = bytearray()
        self.bad = 0

    def feed(self, data: bytes) -> list[UbxFrame]:
        waiting = self._waiting
        waiting += data
        found: list[UbxFrame] = []
        while True:
            start = waiting.find(SYNC)
            if start < 0:
                del waiting[: len(waiting) - waiting.endswith(SYNC[:1])]
                return found
            del waiting[:start]
            if len(waiting) < 6:
                return found
            length = int.from_bytes(waiting[4:6], "little")
            if length > LONGEST_PAYLOAD:
                self.bad += 1
                del waiting[:2]
                continue
            inner = self._find_frame_within(length + 8)
            if inner:
                self.bad += 1
                del waiting[:inner]
                continue
            if len(waiting) < length + 8:
                return found
            if compute_checksum(waiting[2 : length + 6]) == bytes(waiting[length + 6 : length + 8]):
                found.append(UbxFrame((waiting[2], waiting[3]), bytes(waiting[6 : length + 6])))
                del waiting[: length + 8]
            else:
                self.bad += 1
                del waiting[:2]

    def _find_frame_within(self, size: int) -> int:
        """Find the begin of the first whole frame within one of this size; 0 without one.

        A false bit in its length may make a frame seem to reach over seconds of those after it. No
        message holds another; so what is found does not depend on how the stream is cut.
        """
        waiting, start = self._waiting, 0
        found, first_end = 0, min(size, len(self._waiting))
        for _ in range(_INNER_TRIES):
            start = waiting.find(SYNC, start + 2, first_end)
            if start < 0 or len(waiting) < start + 8:
                break
            end = start + 6 + int.from_bytes(waiting[start + 4 : start + 6], "little")
            is_within = end + 2 <= first_end
            if is_within and compute_checksum(waiting[start + 2 : end]) == waiting[end : end + 2]:
                found, first_end = start, end + 1
        return found


def compute_checksum(data: bytes | bytearray) -> bytes:
    """Compute the 8-bit Fletcher checksum over class, id, length and payload."""
    numbers = np.frombuffer(data, dtype=np.uint8).astype(np.int64)
    a, b = numbers.sum(), numbers @ np.arange(len(numbers), 0, -1)
    return bytes((int(a) & 0xFF, int(b) & 0xFF))


def make_frame(kind: tuple[int, int], payload: bytes) -> bytes:
    body = bytes(kind) + len(payload).to_bytes(2, "little") + payload
    return SYNC + body + compute_checksum(body)


class Baseline(NamedTuple):
    """Vector from a receiver's own base antenna to its rover antenna, by the time of the week."""

    stamp_s: float
    heading_deg: float
    std_deg: float


def read_baseline(frame: UbxFrame) -> Baseline | None:
    """Read NAV-RELPOSNED of a rover whose base moves with it; None without a fixed heading.

    The direction to a base that stands in the field is no heading.
    """
    if frame.kind != NAV_RELPOSNED or len(frame.payload) != RELPOSNED.size:
        return None
    version, i_tow_ms, heading, accuracy, flags = RELPOSNED.unpack(frame.payload)
    if version != 1 or flags & _HEADING_MASK != _HAS_HEADING or accuracy == 0:
        return None
    return Baseline(1.0 + i_tow_ms * 1e-3, heading * 1e-5 % 360.0, accuracy * 1e-5)


class UbxFixes:
    """Makes fixes of NAV-PVT, with the millimetres of NAV-HPPOSLLH where a receiver sends it.

    The two come in any order within an epoch; a fix waits for the other one only if the epoch
    before had it.
    """

    def __init__(self) -> None:
        self._pvt: tuple[int, StampedFix] | None = None
        self._precise: tuple[int, float, float, float] | None = None
        self._is_precise = False

    def add(self, frame: UbxFrame) -> list[StampedFix]:
        """Add a frame; gives the fixes that it completes."""
        if frame.kind == NAV_HPPOSLLH and len(frame.payload) >= HPPOSLLH.size:
            self._precise = read_hpposllh(frame.payload)
            return self._join()
        if frame.kind != NAV_PVT or len(frame.payload) < PVT.size:
            return []
        late = self._give_up()
        found = read_pvt(frame.payload)
        if found is None:
            return late
        self._pvt = int.from_bytes(frame.payload[:4], "little"), found
        return late + (self._join() if self._is_precise else self._join() or self._give_up())

    def _join(self) -> list[StampedFix]:
        pvt, precise = self._pvt, self._precise
        if precise is None:
            return []
        self._is_precise = True
        if pvt is None or pvt[0] != precise[0]:
            return []
        self._pvt = None
        stamp_s, fix = pvt[1]
        _, lat_deg, lon_deg, alt_m = precise
        return [StampedFix(stamp_s, _move(fix, lat_deg, lon_deg, alt_m))]

    def _give_up(self) -> list[StampedFix]:
        """Take a fix as it is whose millimetres did not come."""
        if self._pvt is None:
            return []
        (_, found), self._pvt = self._pvt, None
        self._is_precise = False
        return [found]


def read_pvt(payload: bytes) -> StampedFix | None:
    """Read NAV-PVT; None while the receiver has no position that it calls valid.

    Its horizontal accuracy is that of both axes together, its height that over the ellipsoid.
    """
    (
        i_tow_ms, year, month, day, hour, minute, second, valid, _, nano, fix_type, flags, _, _,
        lon, lat, height_mm, _, h_acc_mm, _, north_mmps, east_mmps, down_mmps, _, _, s_acc_mmps,
        _, _,
    ) = PVT.unpack_from(payload)  # fmt: skip
    lat_deg, lon_deg = lat * 1e-7, lon * 1e-7
    if not flags & 1 or fix_type not in FIX_TYPES or not is_place(lat_deg, lon_deg):
        return None
    quality: FixKind | None = _CARRIER.get(flags >> 6)
    if quality is None:
        quality = GnssQuality.DGNSS if flags & 2 else GnssQuality.SINGLE
    quality = _UNMEASURED.get(fix_type, quality)
    stamp_s = i_tow_ms * 1e-3
    if valid & _KNOWS_TIME == _KNOWS_TIME and 1 <= month <= 12 and year in _YEARS:
        stamp_s = calendar.timegm((year, month, day, hour, minute, second)) + nano * 1e-9
    return StampedFix(
        stamp_s,
        GnssFix(
            t_s=0.0, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=height_mm * 1e-3,
            pos_std_m=max(h_acc_mm, 1) * 1e-3 / math.sqrt(2.0), **make_fields(quality),
            velocity_mps=(east_mmps * 1e-3, north_mmps * 1e-3, -down_mmps * 1e-3),
            velocity_std_mps=max(s_acc_mmps, 1) * 1e-3,
        ),
    )  # fmt: skip


def read_fix_type(payload: bytes) -> tuple[int, bool]:
    """Read NAV-PVT's type of fix, and whether the receiver calls it good."""
    return payload[20], bool(payload[21] & 1)


def lacks_fix(frame: UbxFrame) -> bool:
    """Return whether a frame is a NAV-PVT of a receiver that has no position yet, or no more."""
    is_pvt = frame.kind == NAV_PVT and len(frame.payload) >= PVT.size
    return is_pvt and read_pvt(frame.payload) is None


def read_hpposllh(payload: bytes) -> tuple[int, float, float, float] | None:
    """Read time of week (ms), latitude, longitude (degrees) and height (m); None where invalid."""
    _, flags, i_tow_ms, lon, lat, height_mm, _, lon_hp, lat_hp, height_hp, _, _, _ = (
        HPPOSLLH.unpack_from(payload)
    )
    lat_deg, lon_deg = lat * 1e-7 + lat_hp * 1e-9, lon * 1e-7 + lon_hp * 1e-9
    if flags & 1 or not is_place(lat_deg, lon_deg):
        return None
    return i_tow_ms, lat_deg, lon_deg, height_mm * 1e-3 + height_hp * 1e-4


def _move(fix: GnssFix, lat_deg: float, lon_deg: float, alt_m: float) -> GnssFix:
    return msgspec.structs.replace(fix, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m)
