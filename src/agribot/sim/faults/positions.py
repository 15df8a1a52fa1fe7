"""Faults of the GNSS receiver, between the true samples and the batch."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import GnssFix, GnssHeading, GnssQuality, SensorBatch
from agribot.sim.faults.schedule import Fault

RTK_STD_M = 0.014  # stated error of a fixed solution with corrections


class Outage:
    """The receiver gives no fix and no heading of two antennas."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault

    def alter(self, batch: SensorBatch) -> SensorBatch:
        is_on = self._fault.is_on
        return msgspec.structs.replace(
            batch,
            gnss=tuple(fix for fix in batch.gnss if not is_on(fix.t_s)),
            headings=tuple(heading for heading in batch.headings if not is_on(heading.t_s)),
        )


class Offset:
    """Fixes off by a distance in one direction: at once, or at a speed from the fault's begin."""

    def __init__(self, fault: Fault, datum: Datum, rng: np.random.Generator) -> None:
        self._fault, self._frame = fault, MapFrame(datum)
        direction_rad = float(rng.uniform(-math.pi, math.pi))
        self._east, self._north = math.cos(direction_rad), math.sin(direction_rad)

    def alter(self, batch: SensorBatch) -> SensorBatch:
        fixes = tuple(self._move(f) if self._fault.is_on(f.t_s) else f for f in batch.gnss)
        return msgspec.structs.replace(batch, gnss=fixes)

    def _move(self, fix: GnssFix) -> GnssFix:
        fault = self._fault
        off_m = fault.find_number(fix.t_s)
        if fault.name == "gnss.drift":
            off_m *= fix.t_s - fault.begin_s
        east_m, north_m, up_m = self._frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, fix.alt_m)
        lat_deg, lon_deg, alt_m = self._frame.geodetic_from_map(
            east_m + off_m * self._east, north_m + off_m * self._north, up_m
        )
        moved = msgspec.structs.replace(fix, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m)
        if fault.name != "gnss.wrong_fix":
            return moved
        return msgspec.structs.replace(
            moved,
            quality=GnssQuality.RTK_FIXED,
            pos_std_m=min(fix.pos_std_m, RTK_STD_M),
        )


class FrozenReceiver:
    """The last solution again and again, velocity and heading included."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._fix: GnssFix | None = None
        self._heading: GnssHeading | None = None

    def alter(self, batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(
            batch,
            gnss=tuple(self._hold_fix(fix) for fix in batch.gnss),
            headings=tuple(self._hold_heading(heading) for heading in batch.headings),
        )

    def _hold_fix(self, fix: GnssFix) -> GnssFix:
        if self._fix is None or not self._fault.is_on(fix.t_s):
            self._fix = fix
        return msgspec.structs.replace(self._fix, t_s=fix.t_s)

    def _hold_heading(self, heading: GnssHeading) -> GnssHeading:
        if self._heading is None or not self._fault.is_on(heading.t_s):
            self._heading = heading
        return msgspec.structs.replace(self._heading, t_s=heading.t_s)


class NoisyPosition:
    """Fixes that scatter by a multiple of the sigma that the receiver still reports."""

    def __init__(self, fault: Fault, datum: Datum, rng: np.random.Generator) -> None:
        self._fault, self._frame, self._rng = fault, MapFrame(datum), rng

    def alter(self, batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(batch, gnss=tuple(self._shake(fix) for fix in batch.gnss))

    def _shake(self, fix: GnssFix) -> GnssFix:
        if not self._fault.is_on(fix.t_s):
            return fix
        place_m = self._frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, fix.alt_m)
        off_m = (
            _find_more_ratio(self._fault, fix.t_s) * fix.pos_std_m * self._rng.standard_normal(2)
        )
        lat_deg, lon_deg, alt_m = self._frame.geodetic_from_map(
            place_m[0] + float(off_m[0]), place_m[1] + float(off_m[1]), place_m[2]
        )
        return msgspec.structs.replace(fix, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m)


class NoisyVelocity:
    """Velocity noise of a multiple of the sigma that the receiver still reports."""

    def __init__(self, fault: Fault, rng: np.random.Generator) -> None:
        self._fault, self._rng = fault, rng

    def alter(self, batch: SensorBatch) -> SensorBatch:
        return msgspec.structs.replace(batch, gnss=tuple(self._shake(fix) for fix in batch.gnss))

    def _shake(self, fix: GnssFix) -> GnssFix:
        if fix.velocity_mps is None or not self._fault.is_on(fix.t_s):
            return fix
        std_mps = _find_more_ratio(self._fault, fix.t_s) * fix.velocity_std_mps
        x, y, z = (np.array(fix.velocity_mps) + std_mps * self._rng.standard_normal(3)).tolist()
        return msgspec.structs.replace(fix, velocity_mps=(x, y, z))


def _find_more_ratio(fault: Fault, t_s: float) -> float:
    """Find the noise to add, in sigmas: the receiver's own is in the sample already."""
    return math.sqrt(fault.find_number(t_s) ** 2 - 1.0)
