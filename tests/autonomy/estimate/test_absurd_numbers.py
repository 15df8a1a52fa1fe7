"""Single numbers that came to harm on their way, of every sensor: none ends the robot's program."""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest

from agribot.core.messages import BaseFix, GnssFix, GnssHeading, SensorBatch
from tests.autonomy.estimate.noisy_rover import record, rows
from tests.autonomy.estimate.playback import batches, error, localizer

ABSURD = (1e300, -1e300, 1e155, -1e155, 1e30, 1e12, math.nan, math.inf, -math.inf)
HIT = 3  # one of this many messages with a number is spoilt


def beside(fix: GnssFix) -> dict[str, tuple[msgspec.Struct, ...]]:
    """What comes beside a fix of a robot with two antennas and a base station of its own."""
    base = BaseFix(
        t_s=fix.t_s, lat_deg=fix.lat_deg, lon_deg=fix.lon_deg, alt_m=fix.alt_m, pos_std_m=1.0,
        known_lat_deg=fix.lat_deg, known_lon_deg=fix.lon_deg, known_alt_m=fix.alt_m,
    )  # fmt: skip
    return {"base": (base,), "headings": (GnssHeading(t_s=fix.t_s, yaw_map_rad=0.0, std_rad=9.0),)}


def spoil(sample: msgspec.Struct, name: str, absurd: float) -> msgspec.Struct:
    value = getattr(sample, name)
    new = (absurd, *value[1:]) if isinstance(value, tuple) else absurd
    return msgspec.structs.replace(sample, **{name: new})


def spoilt(told: Iterator[SensorBatch], sensor: str, number: str) -> Iterator[SensorBatch]:
    """Spoil the number in one of three messages of the sensor, by each absurd value in turn."""
    count = 0
    for batch in told:
        if batch.gnss:
            batch = msgspec.structs.replace(batch, **beside(batch.gnss[-1]))  # noqa: PLW2901
        samples = []
        for sample in getattr(batch, sensor):
            count += 1
            absurd = ABSURD[count // HIT % len(ABSURD)]
            is_hit = count % HIT == 0 and batch.t_s > 1.0
            samples.append(spoil(sample, number, absurd) if is_hit else sample)
        yield msgspec.structs.replace(batch, **{sensor: tuple(samples)})


@pytest.mark.parametrize(
    ("sensor", "number"),
    [
        *(("gnss", name) for name in ("lat_deg", "lon_deg", "pos_std_m", "velocity_mps",
                                      "velocity_std_mps", "alt_m")),
        *(("base", name) for name in ("lat_deg", "lon_deg", "alt_m", "pos_std_m", "known_lat_deg",
                                      "known_lon_deg", "known_alt_m")),
        *(("headings", name) for name in ("yaw_map_rad", "std_rad")),
        ("mag", "field_t"),
        *(("imu", name) for name in ("gyro_radps", "accel_mps2")),
        *(("wheels", name) for name in ("angle_rad", "speed_radps")),
    ],
)  # fmt: skip
def test_an_absurd_number_neither_ends_the_program_nor_moves_the_pose(
    sensor: str, number: str
) -> None:
    recording = record(rows, 12.0, seed=1)
    into = localizer()
    estimates = [into.update(batch) for batch in spoilt(batches(recording), sensor, number)]
    driven = [e for e in estimates if e.t_s > 6.0]
    assert all(
        map(math.isfinite, (v for e in driven for v in (e.x_map_m, e.y_map_m, e.yaw_map_rad)))
    )
    assert max(float(np.hypot(*error(recording, e)[:2])) for e in driven) < 0.3
