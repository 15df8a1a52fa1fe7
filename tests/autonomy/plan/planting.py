"""The fields that a rover works on, for the planning tests."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.config import FieldConfig, MissionConfig
from agribot.core.facts import NoFixesYet
from agribot.core.messages import (
    Estimate,
    FloatArray,
    GnssQuality,
    Path,
    RequestEvent,
    RequestWord,
)  # fmt: skip
from tests.asking import ask

FARM = FieldConfig()
MISSION = MissionConfig()
FARM_START = (-2.0, 0.0, math.pi / 2)


def in_field_frame(field: FieldConfig, xy_map_m: FloatArray) -> FloatArray:
    """Points (N, 2) as metres along the rows and metres to their right, from the first plant."""
    yaw = math.radians(field.row_yaw_deg)
    delta = xy_map_m - np.array(field.first_row_start_map_m)
    forward, right = (math.cos(yaw), math.sin(yaw)), (math.sin(yaw), -math.cos(yaw))
    return np.stack([delta @ np.array(forward), delta @ np.array(right)], axis=1)


def from_field_frame(
    field: FieldConfig, along_m: float, right_m: float, turned_rad: float
) -> tuple[float, float, float]:
    """A pose in the map, given along and to the right of the first row."""
    yaw = math.radians(field.row_yaw_deg)
    x_m, y_m = field.first_row_start_map_m
    return (
        x_m + along_m * math.cos(yaw) + right_m * math.sin(yaw),
        y_m + along_m * math.sin(yaw) - right_m * math.cos(yaw),
        yaw + turned_rad,
    )


def at(x_m: float, y_m: float, t_s: float, ok: bool = True) -> Estimate:
    return Estimate(
        t_s=t_s, x_map_m=x_m, y_map_m=y_m, yaw_map_rad=0.0, v_mps=0.0, yaw_rate_radps=0.0,
        slip_rad=0.0, pose_cov=(0.0,) * 9, pos_std_m=0.01, yaw_std_rad=0.01,
        quality=GnssQuality.RTK_FIXED, ok=ok, fact=None if ok else NoFixesYet(),
    )  # fmt: skip


def event(action: RequestWord, t_s: float = 0.0) -> RequestEvent:
    return ask(action, t_s=t_s)


def point_at(path: Path, s_m: float) -> tuple[float, float]:
    x_m = float(np.interp(s_m, path.s_m, path.xy_map_m[:, 0]))
    return x_m, float(np.interp(s_m, path.s_m, path.xy_map_m[:, 1]))
