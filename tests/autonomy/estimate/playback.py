"""Plays a recording into a localizer, tick by tick, and compares the result with the truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.messages import Estimate, FloatArray, SensorBatch
from tests.autonomy.estimate.noisy_rover import Recording
from tests.autonomy.estimate.paper_robot import robot


def batches(recording: Recording, tick_hz: float = 50.0) -> Iterator[SensorBatch]:
    """Cut a recording into what arrives between ticks."""
    at = {"wheels": 0, "imu": 0, "mag": 0, "fixes": 0}

    def until(name: str, times: Sequence[float], t_s: float) -> slice:
        first = last = at[name]
        while last < len(times) and times[last] <= t_s + 1e-9:
            last += 1
        at[name] = last
        return slice(first, last)

    wheel_times = [s.t_s for s in recording.wheels]
    imu_times = [s.t_s for s in recording.imu]
    mag_times = [s.t_s for s in recording.mag]
    fix_times = [arrival_s for arrival_s, _ in recording.fixes]
    for tick in range(1, int(recording.truth[-1, 0] * tick_hz + 1e-6) + 1):
        t_s = tick / tick_hz
        yield SensorBatch(
            t_s=t_s,
            wheels=tuple(recording.wheels[until("wheels", wheel_times, t_s)]),
            imu=tuple(recording.imu[until("imu", imu_times, t_s)]),
            mag=tuple(recording.mag[until("mag", mag_times, t_s)]),
            gnss=tuple(f for _, f in recording.fixes[until("fixes", fix_times, t_s)]),
        )


def localizer(
    antenna_body_m: tuple[float, float, float] = (0.0, 0.0, 0.6),
    config: EstimateConfig | None = None,
) -> Localizer:
    return Localizer(config or EstimateConfig(), FieldConfig(), robot(antenna_body_m))


def play(
    recording: Recording, into: Localizer | None = None, tick_hz: float = 50.0
) -> list[Estimate]:
    into = into or localizer()
    return [into.update(batch) for batch in batches(recording, tick_hz)]


def error(recording: Recording, estimate: Estimate) -> FloatArray:
    """Estimate minus truth: east, north in metres and yaw in radians, (3,)."""
    x, y, yaw = recording.pose(estimate.t_s)
    turn = math.remainder(estimate.yaw_map_rad - yaw, math.tau)
    return np.array([estimate.x_map_m - x, estimate.y_map_m - y, turn])
