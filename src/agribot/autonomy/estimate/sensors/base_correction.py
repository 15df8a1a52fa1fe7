"""Differential correction: what a receiver at a known place has wrong, the robot has wrong too."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from agribot.autonomy.estimate.filter.history import Epoch
from agribot.autonomy.estimate.filter.sensor_ranges import MAX_ALT_M
from agribot.autonomy.estimate.sensors.correction import Correction, Measurements
from agribot.autonomy.estimate.sensors.pose_filter import PoseFilter
from agribot.core.messages import BaseFix, GnssFix, GnssQuality, SensorBatch

MAX_AGE_S = 5.0
# Error that a base station leaves in a fix: multipath is each antenna's own.
RESIDUAL_STD_M = 0.4
UNCORRECTED = (GnssQuality.SINGLE, GnssQuality.DGNSS)


class BaseCorrection(Correction[BaseFix]):
    """Keeps what the base station said last; it corrects fixes, and the pose by them only."""

    needs = None
    needs_odometry = False

    def samples(self, batch: SensorBatch) -> Sequence[BaseFix]:
        return batch.base

    def is_usable(self, sample: BaseFix) -> bool:
        is_there = abs(sample.known_lat_deg) <= 90.0 and abs(sample.known_lon_deg) <= 360.0
        lat_deg, lon_deg, alt_m = sample.error()
        return is_there and abs(lat_deg) + abs(lon_deg) <= 720.0 and abs(alt_m) <= MAX_ALT_M

    def measure(self, sample: BaseFix, epoch: Epoch) -> Measurements:
        self.pose.base = sample
        yield from ()


def take_off_base_error(fix: GnssFix, pose: PoseFilter) -> GnssFix | None:
    """Take orbit, clock and atmosphere off a fix; None where that cannot be or need not be."""
    base = pose.base
    if base is None or fix.quality not in UNCORRECTED:
        return None
    if not abs(fix.t_s - base.t_s) <= MAX_AGE_S:
        pose.rejected["base too old"] += 1
        return None
    lat_deg, lon_deg, alt_m = base.error()
    return msgspec.structs.replace(
        fix, lat_deg=fix.lat_deg - lat_deg,
        lon_deg=fix.lon_deg - math.remainder(lon_deg, 360.0), alt_m=fix.alt_m - alt_m,
        quality=GnssQuality.DGNSS, pos_std_m=min(fix.pos_std_m, RESIDUAL_STD_M),
    )  # fmt: skip
