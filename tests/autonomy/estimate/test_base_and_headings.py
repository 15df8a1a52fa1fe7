"""A base station takes the common drift off the fixes; a second antenna gives the heading."""

from __future__ import annotations

import math

import msgspec
import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.geo import MapFrame
from agribot.core.messages import (
    BaseFix,
    Estimate,
    GnssFix,
    GnssHeading,
    GnssQuality,
    ImuSample,
    MagSample,
    SensorBatch,
    WheelSample,
)
from tests.autonomy.estimate.paper_robot import robot

FRAME = MapFrame(FieldConfig().datum)
KNOWN = FRAME.geodetic_from_map(30.0, -20.0, 0.0)


def stand_still(
    seconds: float,
    drift_mps: float,
    *,
    base: bool,
    base_stops_s: float = math.inf,
    heading_rad: float | None = None,
) -> Estimate:
    """A robot at the map's origin facing East, its receiver drifting to the East."""
    localizer = Localizer(EstimateConfig(), FieldConfig(), robot())
    estimate: Estimate | None = None
    for k in range(round(seconds / 0.02)):
        t_s = 0.02 * k
        error_m = drift_mps * t_s
        wheels = WheelSample(t_s=t_s, angle_rad=(0.0,) * 4, speed_radps=(0.0,) * 4)
        batch = SensorBatch(
            t_s=t_s,
            wheels=(wheels,),
            imu=(ImuSample(t_s=t_s, gyro_radps=(0.0, 0.0, 0.0), accel_mps2=(0.0, 0.0, 9.8)),),
        )
        if k % 10 == 0:
            lat, lon, alt = FRAME.geodetic_from_map(error_m, 0.0, 0.6)
            fix = GnssFix(
                t_s=t_s, lat_deg=lat, lon_deg=lon, alt_m=alt, pos_std_m=1.5,
                quality=GnssQuality.SINGLE,
            )  # fmt: skip
            mag = MagSample(t_s=t_s, field_t=(0.0, 3e-5, -4e-5))
            batch = msgspec.structs.replace(batch, gnss=(fix,), mag=(mag,))
        if base and k % 10 == 0 and t_s < base_stops_s:
            lat, lon, alt = FRAME.geodetic_from_map(30.0 + error_m, -20.0, 0.0)
            told = BaseFix(
                t_s=t_s, lat_deg=lat, lon_deg=lon, alt_m=alt, pos_std_m=1.5,
                known_lat_deg=KNOWN[0], known_lon_deg=KNOWN[1], known_alt_m=KNOWN[2],
            )  # fmt: skip
            batch = msgspec.structs.replace(batch, base=(told,))
        if heading_rad is not None and k % 10 == 5:
            told_rad = GnssHeading(t_s=t_s, yaw_map_rad=heading_rad, std_rad=0.007)
            batch = msgspec.structs.replace(batch, headings=(told_rad,))
        estimate = localizer.update(batch)
    assert estimate is not None
    return estimate


def test_a_base_station_cancels_the_drift_that_it_shares() -> None:
    assert abs(stand_still(60.0, 0.05, base=True).x_map_m) < 0.05
    assert stand_still(60.0, 0.05, base=False).x_map_m > 0.15


def test_the_base_makes_the_position_better_known() -> None:
    with_base, alone = (stand_still(20.0, 0.0, base=base) for base in (True, False))
    assert with_base.quality is GnssQuality.DGNSS
    assert with_base.pos_std_m < 0.5 < alone.pos_std_m


def test_a_base_that_falls_silent_leaves_the_position_where_it_was() -> None:
    estimate = stand_still(60.0, 0.05, base=True, base_stops_s=30.0)
    assert estimate.quality is GnssQuality.SINGLE
    assert abs(estimate.x_map_m) < 4.0 * estimate.pos_std_m


def test_two_antennas_overrule_a_compass_that_is_off() -> None:
    estimate = stand_still(20.0, 0.0, base=False, heading_rad=0.1)
    assert estimate.yaw_map_rad == pytest.approx(0.1, abs=0.01)
    assert estimate.yaw_std_rad < 0.01
    assert abs(stand_still(20.0, 0.0, base=False).yaw_map_rad) < 0.01
