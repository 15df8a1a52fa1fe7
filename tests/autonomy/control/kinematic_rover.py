"""A skid-steer rover as kinematics: lag, dead time, slip and wrong yaw gain; perfect sensors."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.core.messages import (
    STOP,
    DriveCommand,
    Estimate,
    GnssQuality,
    ImuSample,
    SensorBatch,
    WheelSample,
)  # fmt: skip
from tests.robot_parts import plain_rover

TICK_S = 0.02
LAG_S = 0.15
DEAD_TICKS = 3  # 50 ms, rounded up


class Soil(NamedTuple):
    """What the ground does to the motion."""

    slip_ratio: float = 0.0
    yaw_gain_ratio: float = 1.0
    crab_rad: float = 0.0
    yaw_shake_radps: float = 0.0
    # North of this, wheels that turn by less than a fraction of those of the other side are held,
    # and the robot stands while the others spin.
    held_from_y_m: float = math.inf
    held_ratio: float = 0.15

    @classmethod
    def of_seed(cls, rng: np.random.Generator) -> Soil:
        return cls(
            slip_ratio=float(rng.uniform(0.0, 0.06)),
            yaw_gain_ratio=1.0 + 0.08 * float(rng.standard_normal()),
            crab_rad=math.radians(float(rng.uniform(-2.0, 2.0))),
            yaw_shake_radps=math.radians(2.0),
        )


class Rover:
    """`crab_rad` pushes to one side of the map, so its sign follows the direction of travel."""

    def __init__(
        self, pose: tuple[float, float, float], soil: Soil, rng: np.random.Generator
    ) -> None:
        self.x_m, self.y_m, self.yaw_rad = pose
        self.t_s = 0.0
        self.v_mps = self.yaw_rate_radps = self.slip_rad = 0.0
        self._soil = soil
        self._rng = rng
        self._wheels_v = self._wheels_w = self._shake = 0.0
        self._queue: deque[DriveCommand] = deque([STOP] * DEAD_TICKS, maxlen=DEAD_TICKS)
        self._right_rad = self._left_rad = 0.0
        self._drive = plain_rover().drive

    def drive(self, command: DriveCommand) -> None:
        """One tick under a command."""
        late = self._queue[0]
        self._queue.append(command)
        accel = min(max((late.v_mps - self._wheels_v) / LAG_S, -1.5), 1.5)
        yaw_accel = min(max((late.yaw_rate_radps - self._wheels_w) / LAG_S, -4.0), 4.0)
        self._wheels_v += accel * TICK_S
        self._wheels_w += yaw_accel * TICK_S
        soil, moving = self._soil, min(1.0, abs(self._wheels_v) / 0.1)
        decay = math.exp(-TICK_S / 0.3)
        noise = math.sqrt(1.0 - decay * decay) * float(self._rng.standard_normal())
        self._shake = decay * self._shake + soil.yaw_shake_radps * noise
        self.v_mps = self._wheels_v * (1.0 - soil.slip_ratio)
        self.yaw_rate_radps = self._wheels_w * soil.yaw_gain_ratio + self._shake * moving
        if self._is_held():
            self.v_mps = self.yaw_rate_radps = 0.0
        self.slip_rad = soil.crab_rad * math.cos(self.yaw_rad - math.pi / 2.0)
        course_rad = self.yaw_rad + self.slip_rad + self.yaw_rate_radps * TICK_S / 2.0
        self.x_m += self.v_mps * TICK_S * math.cos(course_rad)
        self.y_m += self.v_mps * TICK_S * math.sin(course_rad)
        self.yaw_rad = math.remainder(self.yaw_rad + self.yaw_rate_radps * TICK_S, math.tau)
        self.t_s += TICK_S
        self.turn_wheels(DriveCommand(v_mps=self._wheels_v, yaw_rate_radps=self._wheels_w))

    def _is_held(self) -> bool:
        left, right = self._drive.wheel_speeds_radps(self._wheels_v, self._wheels_w)
        inner, outer = sorted((abs(left), abs(right)))
        return self.y_m > self._soil.held_from_y_m and inner < self._soil.held_ratio * outer

    def turn_wheels(self, twist: DriveCommand) -> None:
        """For one tick, as a twist has them turn, whether the robot gets on or not."""
        left, right = self._drive.wheel_speeds_radps(twist.v_mps, twist.yaw_rate_radps)
        self._left_rad += left * TICK_S
        self._right_rad += right * TICK_S

    def estimate(self) -> Estimate:
        return Estimate(
            t_s=self.t_s, x_map_m=self.x_m, y_map_m=self.y_m, yaw_map_rad=self.yaw_rad,
            v_mps=self.v_mps, yaw_rate_radps=self.yaw_rate_radps, slip_rad=self.slip_rad,
            pose_cov=(0.0,) * 9, pos_std_m=0.01, yaw_std_rad=0.01,
            quality=GnssQuality.RTK_FIXED, ok=True,
        )  # fmt: skip

    def batch(self) -> SensorBatch:
        right, left = self._right_rad, self._left_rad
        angles = (right, left, right, left)
        wheel = WheelSample(t_s=self.t_s, angle_rad=angles, speed_radps=(0.0,) * 4)
        hum_radps = 1e-4 * math.sin(1e3 * self.t_s)  # no gyro says the same twice
        gyro_radps = (hum_radps, 0.0, self.yaw_rate_radps)
        imu = ImuSample(t_s=self.t_s, gyro_radps=gyro_radps, accel_mps2=(0.0, 0.0, 9.8))
        return SensorBatch(t_s=self.t_s, wheels=(wheel,), imu=(imu,))


def moved(estimate: Estimate, **changes: object) -> Estimate:
    return msgspec.structs.replace(estimate, **changes)
