"""Slower where the robot knows less well where the crop row is."""

from __future__ import annotations

import math

from agribot.config import MissionConfig
from agribot.messages import Estimate

# What is left of the speed just before the robot must stop: it sees more plants only by moving.
CREEP_RATIO = 0.25


def across_std_m(estimate: Estimate, yaw_map_rad: float) -> float:
    """1 sigma of the position across a direction of the map."""
    xx, xy, _, _, yy, *_ = estimate.pose_cov
    sin, cos = math.sin(yaw_map_rad), math.cos(yaw_map_rad)
    return math.sqrt(max(xx * sin * sin - 2.0 * xy * sin * cos + yy * cos * cos, 0.0))


def caution_ratio(std_m: float, config: MissionConfig) -> float:
    """Part of the speed that an uncertainty across the row allows; 0 beyond the limit."""
    if not std_m <= config.max_row_std_m:
        return 0.0
    if std_m <= config.full_speed_std_m:
        return 1.0
    part = (std_m - config.full_speed_std_m) / (config.max_row_std_m - config.full_speed_std_m)
    return 1.0 - part * (1.0 - CREEP_RATIO)
