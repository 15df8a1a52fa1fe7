"""Differential correction: what a receiver at a known place has wrong, the robot has wrong too."""

from __future__ import annotations

import math
from collections import Counter

import msgspec

from agribot.core.messages import BaseFix, GnssFix, GnssQuality

MAX_AGE_S = 5.0
# Multipath is each antenna's own: this much remains of a fix that a base station corrects.
RESIDUAL_STD_M = 0.4
UNCORRECTED = (GnssQuality.SINGLE, GnssQuality.DGNSS)


class BaseCorrection:
    """Takes orbit, clock and atmosphere off fixes without carrier corrections."""

    def __init__(self, rejected: Counter[str]) -> None:
        self._base: BaseFix | None = None
        self._rejected = rejected

    def hear(self, base: BaseFix) -> None:
        values = (base.t_s, *base.error(), base.known_lat_deg, base.known_lon_deg)
        if not all(map(math.isfinite, values)):
            self._rejected["base not usable"] += 1
        elif self._base is not None and base.t_s <= self._base.t_s:
            self._rejected["base out of order"] += 1
        else:
            self._base = base

    def corrected(self, fix: GnssFix) -> GnssFix | None:
        """The fix without what the base has wrong; None where it cannot be or need not be."""
        base = self._base
        if base is None or fix.quality not in UNCORRECTED:
            return None
        if not abs(fix.t_s - base.t_s) <= MAX_AGE_S:
            self._rejected["base too old"] += 1
            return None
        lat_deg, lon_deg, alt_m = base.error()
        return msgspec.structs.replace(
            fix, lat_deg=fix.lat_deg - lat_deg,
            lon_deg=fix.lon_deg - math.remainder(lon_deg, 360.0), alt_m=fix.alt_m - alt_m,
            quality=GnssQuality.DGNSS, pos_std_m=min(fix.pos_std_m, RESIDUAL_STD_M),
        )  # fmt: skip
