"""GNSS receivers and magnetometers of many rovers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.ekf import Mask
from agribot.lab.bench.nav.batch.gnss import BatchFix
from agribot.lab.bench.nav.batch.localizer import BatchHeading
from agribot.lab.bench.nav.draws import Coins, Draws, wander
from agribot.lab.bench.nav.plant import RoverFleet
from agribot.lab.bench.nav.scenario import DT_S, GnssErrors

# Float ambiguities come after an exponential time and last uniformly long.
OUTAGE_EVERY_S, OUTAGE_S, FLOAT_STD_M, FLOAT_MEMORY_S = 240.0, (5.0, 25.0), 0.3, 10.0
HECTOR_HZ = 1.0 / 3600.0


class Receivers:
    def __init__(
        self, seeds: Sequence[int], gnss: GnssErrors, lever_m: tuple[float, float]
    ) -> None:
        count = len(seeds)
        self._gnss, self._lever_m = gnss, lever_m
        self._draws, self._coins = Draws(seeds, 5, 11), Coins(seeds, 6, 2)
        first = self._draws.normals()
        stds = [gnss.hector_drift_m] if gnss.hector_drift_m else [std for std, _ in gnss.wanders]
        self._bias = [std * first[2 * index : 2 * index + 2] for index, std in enumerate(stds)]
        self._float = np.zeros((2, count))
        self._float_left_s = np.zeros(count)
        self._next_float_s = self._exponential(self._coins.uniforms()[0])

    def sample(self, t_s: float, plant: RoverFleet) -> tuple[BatchFix, BatchHeading | None]:
        gnss, normal = self._gnss, self._draws.normals()
        stated_mps = gnss.velocity_stated_mps
        dt_s = gnss.period_steps * DT_S
        self._wander(dt_s, normal)
        is_float = np.zeros_like(plant.x_m, dtype=bool)
        if gnss.is_corrected:
            is_float = self._lose_ambiguities(t_s, dt_s, normal[9:11])
        cos, sin = np.cos(plant.yaw_rad), np.sin(plant.yaw_rad)
        ahead_m, left_m = self._lever_m
        error = sum(self._bias) + self._float
        ahead_mps = plant.v_mps - plant.yaw_rate_radps * left_m
        left_mps = plant.lateral_mps + plant.yaw_rate_radps * ahead_m
        fix = BatchFix(
            t_s=t_s,
            east_m=plant.x_m + cos * ahead_m - sin * left_m + error[0] + gnss.white_m * normal[4],
            north_m=plant.y_m + sin * ahead_m + cos * left_m + error[1] + gnss.white_m * normal[5],
            pos_std_m=np.where(is_float, FLOAT_STD_M, gnss.stated_m),
            is_float=is_float,
            east_mps=cos * ahead_mps - sin * left_mps + gnss.velocity_std_mps * normal[6],
            north_mps=sin * ahead_mps + cos * left_mps + gnss.velocity_std_mps * normal[7],
            velocity_std_mps=gnss.velocity_std_mps if stated_mps is None else stated_mps,
        )
        if gnss.heading_std_rad is None:
            return fix, None
        yaw_rad = plant.yaw_rad + gnss.heading_std_rad * normal[8]
        seen_rad = np.where(is_float, math.nan, yaw_rad)
        return fix, BatchHeading(t_s, seen_rad, gnss.heading_std_rad)

    def _wander(self, dt_s: float, normal: FloatArray) -> None:
        gnss = self._gnss
        if gnss.hector_drift_m:
            # As the plugin integrates it: its noise grows with dt, not with its root.
            kept, step = math.exp(-dt_s * HECTOR_HZ), dt_s * math.sqrt(2.0 * HECTOR_HZ)
            self._bias[0] = kept * self._bias[0] + step * gnss.hector_drift_m * normal[:2]
        for index, (std_m, memory_s) in enumerate(gnss.wanders):
            fresh = normal[2 * index : 2 * index + 2]
            self._bias[index] = wander(self._bias[index], std_m, memory_s, dt_s, fresh)

    def _lose_ambiguities(self, t_s: float, dt_s: float, normal: FloatArray) -> Mask:
        coin = self._coins.uniforms()
        was = self._float_left_s > 0.0
        self._float_left_s = self._float_left_s - dt_s * was
        ends = was & (self._float_left_s <= 0.0)
        self._float = wander(self._float, FLOAT_STD_M, FLOAT_MEMORY_S, dt_s, normal)
        self._next_float_s = np.where(ends, t_s + self._exponential(coin[0]), self._next_float_s)
        starts = ~was & (t_s > self._next_float_s)
        shortest_s, longest_s = OUTAGE_S
        lasts_s = shortest_s + (longest_s - shortest_s) * coin[1]
        self._float_left_s = np.where(starts, lasts_s, self._float_left_s)
        lost: Mask = self._float_left_s > 0.0
        self._float = self._float * lost
        return lost

    def _exponential(self, uniform: FloatArray) -> FloatArray:
        wait: FloatArray = -OUTAGE_EVERY_S * np.log(1.0 - uniform)
        return wait


class Compasses:
    """Yaw of the magnetometer: mounting, hard iron and motor currents, or hector's noisy field."""

    PERIOD_S = 0.2

    def __init__(self, seeds: Sequence[int], *, is_hector: bool) -> None:
        first, coin = Draws(seeds, 7, 4).normals(), Coins(seeds, 8, 1).uniforms()
        self._draws = Draws(seeds, 9, 4)
        self._is_hector = is_hector
        self._offset_rad = math.radians(3.0) * first[0]
        self._iron_rad = abs(first[1]) * math.radians(4.0)
        self._phase_rad = math.pi * (2.0 * coin[0] - 1.0)
        self._current_rad = np.zeros(len(seeds))
        self._drift = 0.1 * first[2:4]

    def sample(self, plant: RoverFleet) -> FloatArray:
        normal, yaw_rad = self._draws.normals(), plant.yaw_rad
        if self._is_hector:
            kept = math.exp(-self.PERIOD_S * 10.0)
            step = self.PERIOD_S * math.sqrt(20.0) * 0.1
            self._drift = kept * self._drift + step * normal[:2]
            x = 0.5 * np.cos(yaw_rad) + self._drift[0] + 0.1 * normal[2]
            y = -0.5 * np.sin(yaw_rad) + self._drift[1] + 0.1 * normal[3]
            seen: FloatArray = -np.arctan2(y, x)
            return seen
        self._current_rad = wander(
            self._current_rad, math.radians(3.0), 2.0, self.PERIOD_S, normal[0]
        )
        seen = (
            yaw_rad + self._offset_rad + self._iron_rad * np.sin(yaw_rad + self._phase_rad)
            + self._current_rad + math.radians(1.5) * normal[1]
        )  # fmt: skip
        return np.remainder(seen + math.pi, math.tau) - math.pi
