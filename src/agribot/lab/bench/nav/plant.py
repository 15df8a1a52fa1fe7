"""The rovers' truth: drive with lag and dead time on soil that slips, scrubs and slopes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.arrays import clamp
from agribot.lab.bench.nav.draws import Coins, Draws, wander
from agribot.lab.bench.nav.scenario import DT_S, HEADLAND_M, START_STD_M, START_STD_RAD, SoilDrift

DRIVE_LAG_S, DEAD_STEPS = 0.15, 5
MAX_ACCEL_MPS2, MAX_YAW_ACCEL_RADPS2 = 1.5, 4.0
SLIP_MEMORY_S, YAW_GAIN_MEMORY_S, YAW_RATE_MEMORY_S, LATERAL_MEMORY_S = 5.0, 3.0, 0.3, 1.0
MOVING_MPS = 0.1  # the ground disturbs only who moves


class RoverFleet:
    """N rovers; `x_m`, `y_m`, `yaw_rad` (not wrapped) and the velocities are the truth."""

    def __init__(self, seeds: Sequence[int], soil: SoilDrift) -> None:
        count = len(seeds)
        first, second = Draws(seeds, 0, 4).normals(), Coins(seeds, 1, 2).uniforms()
        self._soil = soil
        self._draws = Draws(seeds, 2, 4)
        self._slip = soil.slip_max_ratio * second[0]
        self._slope_rad = soil.slope_max_rad * (2.0 * second[1] - 1.0)
        self._yaw_gain = 1.0 + soil.yaw_gain_std_ratio * first[0]
        self._turn_centre_m = soil.turn_centre_std_m * first[1]
        self.x_m = np.full(count, -HEADLAND_M)
        self.y_m = START_STD_M * first[2]
        self.yaw_rad = START_STD_RAD * first[3]
        self.v_mps, self.lateral_mps, self.yaw_rate_radps = (np.zeros(count) for _ in range(3))
        self.wheel_mps, self.wheel_radps = np.zeros(count), np.zeros(count)
        self._slip_now, self._gain_now, self._shake, self._drift = np.zeros((4, count))
        self._waiting = [(np.zeros(count), np.zeros(count))] * DEAD_STEPS

    def step(self, v_mps: FloatArray, yaw_rate_radps: FloatArray) -> None:
        soil, normal = self._soil, self._draws.normals()
        self._waiting = [*self._waiting[1:], (v_mps, yaw_rate_radps)]
        asked_mps, asked_radps = self._waiting[0]
        dv = clamp((asked_mps - self.wheel_mps) / DRIVE_LAG_S, -MAX_ACCEL_MPS2, MAX_ACCEL_MPS2)
        self.wheel_mps = self.wheel_mps + dv * DT_S
        dw = (asked_radps - self.wheel_radps) / DRIVE_LAG_S
        dw = clamp(dw, -MAX_YAW_ACCEL_RADPS2, MAX_YAW_ACCEL_RADPS2)
        self.wheel_radps = self.wheel_radps + dw * DT_S
        self._slip_now = wander(self._slip_now, soil.slip_std_ratio, SLIP_MEMORY_S, DT_S, normal[0])
        self._gain_now = wander(
            self._gain_now, soil.yaw_gain_walk_ratio, YAW_GAIN_MEMORY_S, DT_S, normal[1]
        )
        self._shake = wander(
            self._shake, soil.yaw_rate_std_radps, YAW_RATE_MEMORY_S, DT_S, normal[2]
        )
        self._drift = wander(self._drift, soil.lateral_std_mps, LATERAL_MEMORY_S, DT_S, normal[3])
        moving = np.minimum(1.0, abs(self.wheel_mps) / MOVING_MPS)
        self.v_mps = self.wheel_mps * (1.0 - self._slip - self._slip_now)
        self.yaw_rate_radps = (
            self.wheel_radps * (self._yaw_gain + self._gain_now) + self._shake * moving
        )
        self.lateral_mps = (
            self._slope_rad * np.cos(self.yaw_rad) * self.v_mps
            + self._drift * moving
            + self._turn_centre_m * self.yaw_rate_radps
        )
        self.yaw_rad = self.yaw_rad + self.yaw_rate_radps * DT_S
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        self.x_m = self.x_m + (self.v_mps * cos - self.lateral_mps * sin) * DT_S
        self.y_m = self.y_m + (self.v_mps * sin + self.lateral_mps * cos) * DT_S


class Proprioception:
    """Gyro and wheels at every step."""

    def __init__(self, seeds: Sequence[int]) -> None:
        first = Draws(seeds, 3, 2).normals()
        self._bias_radps = math.radians(0.05) * first[0]
        self._scale = 1.0 + 0.01 * first[1]
        self._draws = Draws(seeds, 4, 3)

    def read(self, plant: RoverFleet) -> tuple[FloatArray, FloatArray]:
        """Wheel speed (m/s) and yaw rate (rad/s) as measured."""
        normal = self._draws.normals()
        self._bias_radps = self._bias_radps + math.radians(0.003) * math.sqrt(DT_S) * normal[0]
        rate = plant.yaw_rate_radps * self._scale + self._bias_radps
        return plant.wheel_mps + 0.01 * normal[2], rate + math.radians(0.1) * normal[1]
