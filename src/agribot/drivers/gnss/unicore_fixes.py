"""Fixes and headings of Unicore receivers: BESTNAV and UNIHEADING, in ASCII and in binary.

Source: Unicore N4 high precision products, reference commands manual, BESTNAV and UNIHEADING.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from agribot.core.geo import is_place
from agribot.core.messages import GnssFix, GnssQuality
from agribot.drivers.gnss.fix_kinds import DEAD_RECKONING, HELD, FixKind, make_fields
from agribot.drivers.gnss.nmea import StampedFix, read_finite
from agribot.drivers.gnss.unicore import UnicoreFrame

BESTNAV_BODY = struct.Struct("<IIdddfIfff4sff8BIIffdddff")
UNIHEADING_BODY = struct.Struct("<IIfffIff4s8B")
# Types of positions and headings by their numbers; the rest are no places.
TYPES = {
    1: "FIXEDPOS", 16: "SINGLE", 17: "PSRDIFF", 18: "SBAS", 32: "L1_FLOAT", 33: "IONOFREE_FLOAT",
    34: "NARROW_FLOAT", 48: "L1_INT", 49: "WIDE_INT", 50: "NARROW_INT", 52: "INS",
    53: "INS_PSRSP", 54: "INS_PSRDIFF", 55: "INS_RTKFLOAT", 56: "INS_RTKFIXED",
    68: "PPP_CONVERGING", 69: "PPP",
}  # fmt: skip
_BY_QUALITY: dict[FixKind, tuple[str, ...]] = {
    GnssQuality.SINGLE: ("SINGLE", "INS_PSRSP"),
    GnssQuality.DGNSS: ("PSRDIFF", "SBAS", "WAAS", "INS_PSRDIFF", "PPP_CONVERGING", "PPP"),
    GnssQuality.RTK_FLOAT: ("L1_FLOAT", "IONOFREE_FLOAT", "NARROW_FLOAT", "INS_RTKFLOAT"),
    GnssQuality.RTK_FIXED: ("L1_INT", "WIDE_INT", "NARROW_INT", "INS_RTKFIXED"),
    DEAD_RECKONING: ("INS",),
    HELD: ("FIXEDPOS",),
}
QUALITY = {name: quality for quality, names in _BY_QUALITY.items() for name in names}
_COMPUTED = ("SOL_COMPUTED", 0)
_LEAST_STD = 1e-3
# Fields of the ASCII forms that are read, in the order of the numbers below.
_NAV_FIELDS = (2, 3, 4, 5, 7, 8, 25, 26, 27, 29)
_HEADING_FIELDS = (3, 6)


class Solution(NamedTuple):
    """Whether and how something was computed, and the numbers of it."""

    is_computed: bool
    kind: str
    numbers: tuple[float, ...]


class UnicoreHeading(NamedTuple):
    """Heading from the first antenna to the second one, clockwise from North."""

    stamp_s: float
    heading_deg: float
    std_deg: float


def read_fix(frame: UnicoreFrame) -> StampedFix | None:
    """Read BESTNAV; None without a position of satellites or of dead reckoning.

    Raises: ValueError, IndexError, struct.error: fields that are no numbers, or too few.
    """
    place, velocity = _read_bestnav(frame)
    quality = QUALITY.get(place.kind)
    if not place.is_computed or quality is None:
        return None
    lat_deg, lon_deg, alt_m, separation_m, lat_std_m, lon_std_m = place.numbers
    if not is_place(lat_deg, lon_deg):
        return None
    speed_mps, course_deg, up_mps, std_mps = velocity.numbers
    course_rad = math.radians(course_deg)
    horizontal_mps = speed_mps * math.sin(course_rad), speed_mps * math.cos(course_rad)
    fix = GnssFix(
        t_s=0.0, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m + separation_m,
        **make_fields(quality),
        pos_std_m=max(math.hypot(lat_std_m, lon_std_m) / math.sqrt(2.0), _LEAST_STD),
        velocity_mps=(*horizontal_mps, up_mps) if velocity.is_computed else None,
        velocity_std_mps=max(std_mps, _LEAST_STD) if velocity.is_computed and std_mps else 0.1,
    )  # fmt: skip
    return StampedFix(frame.stamp_s, fix)


def read_heading(frame: UnicoreFrame) -> UnicoreHeading | None:
    """Read UNIHEADING; None without a heading whose ambiguities are fixed.

    Raises: ValueError, IndexError, struct.error: fields that are no numbers, or too few.
    """
    if frame.fields:
        numbers = tuple(read_finite(frame.fields[k]) for k in _HEADING_FIELDS)
        found = Solution(frame.fields[0] in _COMPUTED, frame.fields[1], numbers)
    else:
        status, kind, _, heading, _, _, std, *_ = UNIHEADING_BODY.unpack_from(frame.body)
        found = Solution(status in _COMPUTED, TYPES.get(kind, ""), (heading, std))
    heading_deg, std_deg = found.numbers
    is_fixed = found.is_computed and QUALITY.get(found.kind) is GnssQuality.RTK_FIXED
    if not is_fixed or not std_deg > 0.0 or not math.isfinite(heading_deg):
        return None
    return UnicoreHeading(frame.stamp_s, heading_deg % 360.0, std_deg)


def _read_bestnav(frame: UnicoreFrame) -> tuple[Solution, Solution]:
    """Read place and velocity: degrees, m, and 1 sigma of both axes; m/s, degrees and 1 sigma."""
    if frame.fields:
        fields = frame.fields
        numbers = tuple(read_finite(fields[k]) for k in _NAV_FIELDS)
        return (
            Solution(fields[0] in _COMPUTED, fields[1], numbers[:6]),
            Solution(fields[21] in _COMPUTED, fields[22], numbers[6:]),
        )
    (
        status, kind, lat, lon, height, separation, _, lat_std, lon_std, _, _, _, _, *_,
        speed_status, speed_kind, _, _, speed, course, up, _, speed_std,
    ) = BESTNAV_BODY.unpack_from(frame.body)  # fmt: skip
    numbers = (lat, lon, height, separation, lat_std, lon_std, speed, course, up, speed_std)
    if not all(map(math.isfinite, numbers)):
        raise ValueError("BESTNAV with a number that is not finite")
    return (
        Solution(status in _COMPUTED, TYPES.get(kind, ""), numbers[:6]),
        Solution(speed_status in _COMPUTED, str(speed_kind), numbers[6:]),
    )
