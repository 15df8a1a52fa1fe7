"""The rover's truth: drive with lag and dead time on soil that slips, scrubs and slopes."""

from __future__ import annotations

import math
from collections import deque

from agribot.core.arithmetic import clamp
from agribot.lab.bench.nav.draws import Coins, Draws, SlowError
from agribot.lab.bench.nav.scenario import DT_S, HEADLAND_M, START_STD_M, START_STD_RAD, SoilDrift

DRIVE_LAG_S, DEAD_STEPS = 0.15, 5
MAX_ACCEL_MPS2, MAX_YAW_ACCEL_RADPS2 = 1.5, 4.0
SLIP_MEMORY_S, YAW_GAIN_MEMORY_S, YAW_RATE_MEMORY_S, LATERAL_MEMORY_S = 5.0, 3.0, 0.3, 1.0
MOVING_MPS = 0.1  # the ground disturbs only who moves


class SoilRover:
    """One rover; `x_m`, `y_m`, `yaw_rad` (not wrapped) and the velocities are the truth.

    `wheel_mps` and `wheel_radps` are what its wheels do, `v_mps`, `lateral_mps` and
    `yaw_rate_radps` what the soil makes of it, in body axes.
    """

    def __init__(self, seed: int, soil: SoilDrift) -> None:
        first, second = Draws(seed, 0, 4).take(), Coins(seed, 1, 2).take()
        self._draws = Draws(seed, 2, 4)
        self._slip_ratio = soil.slip_max_ratio * second[0]
        self._slope_rad = soil.slope_max_rad * (2.0 * second[1] - 1.0)
        self._yaw_gain_ratio = 1.0 + soil.yaw_gain_std_ratio * first[0]
        self._turn_centre_m = soil.turn_centre_std_m * first[1]
        self._slip = SlowError(soil.slip_std_ratio, SLIP_MEMORY_S, DT_S)
        self._gain = SlowError(soil.yaw_gain_walk_ratio, YAW_GAIN_MEMORY_S, DT_S)
        self._shake = SlowError(soil.yaw_rate_std_radps, YAW_RATE_MEMORY_S, DT_S)
        self._drift = SlowError(soil.lateral_std_mps, LATERAL_MEMORY_S, DT_S)
        self.x_m, self.y_m = -HEADLAND_M, START_STD_M * first[2]
        self.yaw_rad = START_STD_RAD * first[3]
        self.v_mps = self.lateral_mps = self.yaw_rate_radps = 0.0
        self.wheel_mps = self.wheel_radps = 0.0
        self._commands = deque([(0.0, 0.0)] * DEAD_STEPS)

    def step(self, v_mps: float, yaw_rate_radps: float) -> None:
        """Move by one step of `DT_S` under a command."""
        self._commands.append((v_mps, yaw_rate_radps))
        self._drive(*self._commands.popleft())
        slip, gain, shake, drift = self._draws.take()
        moving = min(1.0, abs(self.wheel_mps) / MOVING_MPS)
        self.v_mps = self.wheel_mps * (1.0 - self._slip_ratio - self._slip.step(slip))
        turns_ratio = self._yaw_gain_ratio + self._gain.step(gain)
        self.yaw_rate_radps = self.wheel_radps * turns_ratio + self._shake.step(shake) * moving
        self.lateral_mps = (
            self._slope_rad * math.cos(self.yaw_rad) * self.v_mps
            + self._drift.step(drift) * moving
            + self._turn_centre_m * self.yaw_rate_radps
        )
        self.yaw_rad += self.yaw_rate_radps * DT_S
        east_mps, north_mps = self.velocity_mps
        self.x_m += east_mps * DT_S
        self.y_m += north_mps * DT_S

    @property
    def velocity_mps(self) -> tuple[float, float]:
        """Velocity in the map, East and North."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return self.v_mps * cos - self.lateral_mps * sin, self.v_mps * sin + self.lateral_mps * cos

    def _drive(self, v_mps: float, yaw_rate_radps: float) -> None:
        """Let the wheels follow a command, with the lag and the limits of the drive."""
        accel_mps2 = (v_mps - self.wheel_mps) / DRIVE_LAG_S
        self.wheel_mps += clamp(accel_mps2, -MAX_ACCEL_MPS2, MAX_ACCEL_MPS2) * DT_S
        accel_radps2 = (yaw_rate_radps - self.wheel_radps) / DRIVE_LAG_S
        self.wheel_radps += clamp(accel_radps2, -MAX_YAW_ACCEL_RADPS2, MAX_YAW_ACCEL_RADPS2) * DT_S
