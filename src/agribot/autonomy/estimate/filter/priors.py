"""What the filter believes of drive and gyro: first spreads, noise of motion, ageing."""

from __future__ import annotations

import math

from agribot.autonomy.estimate.filter.ekf import GYRO_BIAS, SLIP, WHEEL_SCALE, MotionNoise
from agribot.core.config import EstimateConfig

# Slip of the turning centre: a skidding robot does not turn exactly about its centre.
TURN_CENTRE_M_PER_SQRT_RAD = 0.03
# Error of a MEMS gyro's scale, about 1 %: a half turn then ends 1.8 degrees off, 1 sigma.
GYRO_SCALE_STD_RATIO = 0.01
# Wheels measure the length of a way except for their slip.
ALONG_WALK_M_PER_SQRT_M = 0.005
GYRO_BIAS_WALK_RADPS_PER_SQRT_S = 7e-5
# The grip of the wheels changes with every patch of soil, the slope under the robot slowly.
WHEEL_SCALE_MEMORY_S, SLIP_MEMORY_S = 30.0, 200.0


def initial_std(config: EstimateConfig) -> tuple[float, ...]:
    """Give 1 sigma of each state before the first measurement."""
    return (
        1e3, 1e3, math.pi, config.gyro_bias_std_radps, config.wheel_scale_std_ratio,
        config.slip_std_rad, GYRO_SCALE_STD_RATIO, 1.0, 1.0, config.mag_bias_std_rad, 0.0,
    )  # fmt: skip


def motion_noise(config: EstimateConfig) -> MotionNoise:
    return MotionNoise(
        along_m2_per_m=ALONG_WALK_M_PER_SQRT_M**2,
        across_m2_per_m=config.position_walk_m_per_sqrt_m**2,
        position_m2_per_rad=TURN_CENTRE_M_PER_SQRT_RAD**2,
        yaw_rad2_per_s=config.gyro_walk_rad_per_sqrt_s**2,
    )


def slow_ageing(config: EstimateConfig, age_s: float) -> tuple[tuple[int, float, float], ...]:
    """Say how gyro bias, wheel scale and slip age, as Ekf.relax takes it."""
    return (
        (GYRO_BIAS, 1.0, GYRO_BIAS_WALK_RADPS_PER_SQRT_S**2 * age_s),
        _fading(WHEEL_SCALE, config.wheel_scale_std_ratio, age_s / WHEEL_SCALE_MEMORY_S),
        _fading(SLIP, config.slip_std_rad, age_s / SLIP_MEMORY_S),
    )


def _fading(state: int, std: float, part: float) -> tuple[int, float, float]:
    """Ageing of an error that keeps its spread and forgets its value after `part` = 1."""
    factor = math.exp(-part)
    return state, factor, std**2 * (1.0 - factor * factor)
