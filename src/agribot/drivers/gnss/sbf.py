"""SBF of Septentrio receivers: bytes to blocks, blocks to fixes and headings.

Source: Septentrio mosaic-X5 reference guide 4.14: block header, PVTGeodetic, PosCovGeodetic,
VelCovGeodetic, AttEuler and AttCovEuler.
"""

from __future__ import annotations

import binascii
import calendar
import math
import struct
from typing import NamedTuple

from agribot.core.geo import is_place
from agribot.core.messages import GnssFix, GnssQuality, Vec3
from agribot.drivers.gnss.epochs import EpochJoiner
from agribot.drivers.gnss.fix_kinds import HELD, FixKind, make_fields
from agribot.drivers.gnss.nmea import StampedFix

SYNC = b"$@"
PVT, POS_COV, VEL_COV, ATT, ATT_COV = 4007, 5906, 5908, 5938, 5939
NAMES = {
    PVT: "PVTGeodetic", POS_COV: "PosCovGeodetic", VEL_COV: "VelCovGeodetic", ATT: "AttEuler",
    ATT_COV: "AttCovEuler", 4006: "PVTCartesian", 4027: "MeasEpoch", 4001: "DOP",
    5914: "ReceiverTime", 4014: "ReceiverStatus", 4013: "ChannelStatus",
}  # fmt: skip
PVT_BODY = struct.Struct("<IHBBdddfffff")  # up to the course
H_ACCURACY = 82  # offset of the accuracy, in cm, twice the root mean square; since revision 2
# Body of a position's or a velocity's covariance: three variances.
COV_BODY = struct.Struct("<IHBBfff")
ATT_BODY = struct.Struct("<IHBBHHf")
ATT_COV_BODY = struct.Struct("<IHBBf")
SIZES = {
    PVT: PVT_BODY.size, POS_COV: COV_BODY.size, VEL_COV: COV_BODY.size, ATT: ATT_BODY.size,
    ATT_COV: ATT_COV_BODY.size,
}  # fmt: skip
QUALITY: dict[int, FixKind] = {
    1: GnssQuality.SINGLE, 2: GnssQuality.DGNSS, 3: HELD, 4: GnssQuality.RTK_FIXED,
    5: GnssQuality.RTK_FLOAT, 6: GnssQuality.DGNSS, 7: GnssQuality.RTK_FIXED,
    8: GnssQuality.RTK_FLOAT, 10: GnssQuality.DGNSS,
}  # fmt: skip
_FIXED_ATTITUDE = (2, 4)
_HEAD_BYTES, _LONGEST = 8, 8192
_LIMIT = 1e9  # largest known value; an unknown one is -2e10
_NO_TIME_MS, _NO_WEEK = 0xFFFFFFFF, 0xFFFF
_GPS_EPOCH_S = calendar.timegm((1980, 1, 6, 0, 0, 0))
_WEEK_S = 604_800.0
USUAL_STD_M = 2.5  # default of an axis without a stated value


class SbfBlock(NamedTuple):
    """`number` is that of its kind, without its revision; `body` what follows the header."""

    number: int
    body: bytes

    @property
    def name(self) -> str:
        return NAMES.get(self.number, f"SBF {self.number}")


class SbfHeading(NamedTuple):
    """The heading of the line between two antennas; `std_deg` is None without AttCovEuler."""

    stamp_s: float
    heading_deg: float
    std_deg: float | None


class SbfDecoder:
    """Finds blocks in a stream of bytes; what is broken is counted in `bad` and left out."""

    def __init__(self) -> None:
        self._waiting = bytearray()
        self.bad = 0

    def feed(self, data: bytes) -> list[SbfBlock]:
        waiting = self._waiting
        waiting += data
        found: list[SbfBlock] = []
        start = 0
        while (start := waiting.find(SYNC, start)) >= 0 and len(waiting) - start >= _HEAD_BYTES:
            checksum, number, length = struct.unpack_from("<HHH", waiting, start + 2)
            if length % 4 or not _HEAD_BYTES <= length <= _LONGEST:
                start += 2
                continue
            if len(waiting) - start < length:
                break
            if binascii.crc_hqx(waiting[start + 4 : start + length], 0) == checksum:
                body = bytes(waiting[start + _HEAD_BYTES : start + length])
                found.append(SbfBlock(number & 0x1FFF, body))
                start += length
            else:
                self.bad += 1
                start += 2
        is_cut = waiting.endswith(SYNC[:1])
        del waiting[: start if start >= 0 else len(waiting) - is_cut]
        return found


class SbfFixes:
    """Joins the blocks of an epoch to a fix and a heading."""

    def __init__(self) -> None:
        self._places: EpochJoiner[int] = EpochJoiner()
        self._attitudes: EpochJoiner[int] = EpochJoiner()

    def add(self, block: SbfBlock) -> tuple[list[StampedFix], list[SbfHeading]]:
        """Add a block; gives the fixes and the headings that it completes."""
        number, body = block
        if len(body) < SIZES.get(number, _LONGEST):
            return [], []
        time_ms = int.from_bytes(body[:4], "little")
        if number in (ATT, ATT_COV):
            attitudes = self._attitudes.add(time_ms, number, body)
            headings = [_read_heading(parts) for _, parts in attitudes]
            return [], [heading for heading in headings if heading is not None]
        fixes = [_read_fix(parts) for _, parts in self._places.add(time_ms, number, body)]
        return [fix for fix in fixes if fix is not None], []


def lacks_fix(block: SbfBlock) -> bool:
    """Return whether a block is a PVTGeodetic of a receiver without a position."""
    is_pvt = block.number == PVT and len(block.body) >= PVT_BODY.size
    return is_pvt and _read_fix({PVT: block.body}) is None


def _read_fix(parts: dict[int, bytes]) -> StampedFix | None:
    if PVT not in parts:
        return None
    time_ms, week, mode, error, lat, lon, height, _, north, east, up, _ = PVT_BODY.unpack_from(
        parts[PVT]
    )
    quality = QUALITY.get(mode & 0xF)
    if error or quality is None or not _is_known(lat, lon):
        return None
    lat_deg, lon_deg = math.degrees(lat), math.degrees(lon)
    if not is_place(lat_deg, lon_deg):
        return None
    velocity_mps = _read_velocity(north, east, up)
    fix = GnssFix(
        t_s=0.0, lat_deg=lat_deg, lon_deg=lon_deg, pos_std_m=_read_std_m(parts),
        alt_m=height if _is_known(height) else math.nan, **make_fields(quality),
        velocity_mps=velocity_mps, velocity_std_mps=_read_std(parts.get(VEL_COV)) or 0.1,
    )  # fmt: skip
    return StampedFix(_make_stamp_s(week, time_ms), fix)


def _read_velocity(north: float, east: float, up: float) -> Vec3 | None:
    if not _is_known(north, east):
        return None
    return east, north, up if _is_known(up) else math.nan


def _is_known(*numbers: float) -> bool:
    return all(abs(number) < _LIMIT for number in numbers)


def _read_std_m(parts: dict[int, bytes]) -> float:
    """Read 1 sigma of an axis of PosCovGeodetic, or else of PVTGeodetic's accuracy."""
    std_m = _read_std(parts.get(POS_COV))
    body = parts[PVT]
    if std_m is None and len(body) >= H_ACCURACY + 2:
        accuracy_cm = int.from_bytes(body[H_ACCURACY : H_ACCURACY + 2], "little")
        std_m = accuracy_cm * 0.01 / 2.0 / math.sqrt(2.0) if accuracy_cm != 0xFFFF else None
    return max(USUAL_STD_M if std_m is None else std_m, 1e-3)


def _read_std(covariance: bytes | None) -> float | None:
    """Read 1 sigma of a horizontal axis of two variances; None without them."""
    if covariance is None:
        return None
    _, _, _, error, first, second, _ = COV_BODY.unpack_from(covariance)
    variance = 0.5 * (first + second)
    is_known = not error and _is_known(first, second) and variance > 0.0
    return math.sqrt(variance) if is_known else None


def _read_heading(parts: dict[int, bytes]) -> SbfHeading | None:
    """Read AttEuler; None without fixed ambiguities."""
    if ATT not in parts:
        return None
    time_ms, week, _, error, mode, _, heading_deg = ATT_BODY.unpack_from(parts[ATT])
    if error or mode not in _FIXED_ATTITUDE or not 0.0 <= heading_deg <= 360.0:
        return None
    std_deg = None
    if ATT_COV in parts:
        _, _, _, error, variance = ATT_COV_BODY.unpack_from(parts[ATT_COV])
        std_deg = math.sqrt(variance) if not error and 0.0 < variance < math.inf else None
    return SbfHeading(_make_stamp_s(week, time_ms), heading_deg, std_deg)


def _make_stamp_s(week: int, time_ms: int) -> float:
    is_known = week != _NO_WEEK and time_ms != _NO_TIME_MS
    return _GPS_EPOCH_S + week * _WEEK_S + time_ms * 1e-3 if is_known else 0.0
