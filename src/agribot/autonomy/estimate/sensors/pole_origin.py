"""The map of a robot that knows its field by a base station on a pole.

The origin is the mean of the pole's first fixes, or its known place, and stays where it is from
then on. What the pole's later fixes are off it is common to all receivers near by, and is taken
off the robot's fixes.
"""

from __future__ import annotations

import math

from agribot.core.geo import Datum, MapFrame

FIRST_FIXES = 25  # five seconds of a receiver at 5 Hz
MAX_AGE_S = 5.0

Geodetic = tuple[float, float, float]  # latitude and longitude in degrees, altitude in metres


def is_place(place: Geodetic) -> bool:
    lat_deg, lon_deg, alt_m = place
    return math.isfinite(alt_m) and abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0


class PoleOrigin:
    """Takes the pole's fixes and corrects others by them; `frame` is None until it is known."""

    def __init__(self, known: Datum | None = None, first_fixes: int = FIRST_FIXES) -> None:
        self.frame = None if known is None else MapFrame(known)
        self._first_fixes = first_fixes
        self._first: list[Geodetic] = []
        self._offset_deg_m: Geodetic | None = None
        self._heard_s = -math.inf

    def update_pole(self, t_s: float, place: Geodetic) -> None:
        """Take a fix of the pole; one that is no place on Earth, or not newer, is ignored."""
        if not is_place(place) or not t_s > self._heard_s:
            return
        if self.frame is None:
            self._collect(place)
        if self.frame is not None:
            origin = self.frame.datum
            self._offset_deg_m = (
                place[0] - origin.lat_deg,
                math.remainder(place[1] - origin.lon_deg, 360.0),
                place[2] - origin.alt_m,
            )
        self._heard_s = t_s

    def correct(self, t_s: float, place: Geodetic) -> Geodetic | None:
        """Take the pole's error off a robot's fix; None without a fresh pole."""
        if self._offset_deg_m is None or not abs(t_s - self._heard_s) <= MAX_AGE_S:
            return None
        lat, lon, alt = self._offset_deg_m
        return place[0] - lat, math.remainder(place[1] - lon, 360.0), place[2] - alt

    def _collect(self, place: Geodetic) -> None:
        self._first.append(place)
        if len(self._first) < self._first_fixes:
            return
        lat0, lon0, alt0 = self._first[0]
        count = len(self._first)
        lat = lat0 + sum(p[0] - lat0 for p in self._first) / count
        lon = lon0 + sum(math.remainder(p[1] - lon0, 360.0) for p in self._first) / count
        alt = alt0 + sum(p[2] - alt0 for p in self._first) / count
        self.frame = MapFrame(Datum(lat_deg=lat, lon_deg=math.remainder(lon, 360.0), alt_m=alt))
