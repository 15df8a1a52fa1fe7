"""Where a base says that it stands: far from here, or elsewhere than in an earlier run.

A base that was set up anew with other coordinates shifts every position by the difference, and the
receiver still reports centimetres. Its place is kept from run to run, by caster and station.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime

import msgspec
import numpy as np

from agribot.core.geo import Datum, MapFrame, ecef_from_geodetic, geodetic_from_ecef
from agribot.core.home import find_machine_file
from agribot.core.messages import GnssFix, Vec3
from agribot.core.whole_file import write_at_once
from agribot.drivers.gnss.rtcm import HeardBase

FOLDER = "bases"
# Largest distance of a base that corrects a receiver: networks of them carry over 50 to 70 km
# (Swift Navigation, "What is an RTK baseline"), and the millimetre per kilometre that makers of
# receivers state (u-blox, ZED-F9P data sheet: 1 cm + 1 ppm) is 20 cm by then.
_FARTHEST_BASE_M = 200e3
# Least distance from the Earth's centre; a base without a place of its own reports less.
_LEAST_RADIUS_M = 6e6
# Distances between which the same mast has other coordinates. Farther away it is another mast.
_SAME_PLACE_M, _OTHER_MAST_M = 0.02, 100.0


class KeptBase(msgspec.Struct, frozen=True):
    """Earth-centred place of a base, and the time at which it was first heard there."""

    ecef_m: Vec3
    since: str


class BaseMemory:
    """Keeps the places of the stations of one caster in a file."""

    def __init__(self, caster: str) -> None:
        self.path = find_machine_file(FOLDER, caster)

    def compare(self, base: HeardBase) -> str:
        """Say how far a station stands from where it stood, and keep the place of a new one.

        Empty where it stands there still. A virtual station is where its network puts it each time.
        """
        if base.is_virtual:
            return ""
        kept = self._read()
        before = kept.get(base.station)
        apart_m = _find_offset(before.ecef_m, base.ecef_m) if before is not None else None
        if before is None or apart_m is None or abs(apart_m) >= _OTHER_MAST_M:
            since = datetime.now(UTC).date().isoformat()
            self._write(kept | {base.station: KeptBase(base.ecef_m, since)})
            return ""
        if abs(apart_m) <= _SAME_PLACE_M:
            return ""
        return (
            f"the base says to stand {apart_m.imag:+.2f} m north and {apart_m.real:+.2f} m east of "
            f"where it has stood since {before.since}, which moves every position by that; give "
            f"it its former coordinates, or measure the field again and remove {self.path}"
        )

    def _read(self) -> dict[int, KeptBase]:
        try:
            return msgspec.json.decode(self.path.read_bytes(), type=dict[int, KeptBase])
        except (OSError, msgspec.DecodeError, UnicodeDecodeError):
            return {}

    def _write(self, kept: dict[int, KeptBase]) -> None:
        """Keep the places; a disk that takes no file loses the comparison of the next run."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_at_once(self.path, msgspec.json.encode(kept))
        except OSError:
            return


def _find_offset(before_m: Vec3, now_m: Vec3) -> complex:
    """Find how far a place is from another, East + i North, m."""
    lat_deg, lon_deg, alt_m = geodetic_from_ecef(np.array(before_m))
    frame = MapFrame(Datum(lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m))
    east_m, north_m, _ = frame.map_from_geodetic(*geodetic_from_ecef(np.array(now_m)))
    return complex(east_m, north_m)


def doubt_base(base_m: Vec3, fix: GnssFix) -> str:
    """Say why a base at that place, Earth-centred, corrects nothing at a fix; empty if it may."""
    if math.hypot(*base_m) < _LEAST_RADIUS_M:
        return (
            "the base says to stand inside of the Earth: its own place is not set; set it, "
            "or choose another mountpoint"
        )
    alt_m = fix.alt_m if math.isfinite(fix.alt_m) else 0.0  # nothing beside 200 km
    distance_m = math.dist(base_m, ecef_from_geodetic(fix.lat_deg, fix.lon_deg, alt_m))
    if distance_m <= _FARTHEST_BASE_M:
        return ""
    lat_deg, lon_deg, _ = geodetic_from_ecef(np.array(base_m))
    return (
        f"the base says to stand at latitude {lat_deg:.2f}, longitude {lon_deg:.2f}, "
        f"{distance_m / 1e3:.0f} km from here; the limit is {_FARTHEST_BASE_M / 1e3:.0f} km; "
        "choose a mountpoint nearby, or set the base's place"
    )
