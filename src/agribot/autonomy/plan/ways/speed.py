"""How fast the mission wants to be at each point of its path."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.core.arithmetic import view_floats
from agribot.core.config import MissionConfig, SafetyConfig
from agribot.core.geo import is_backwards
from agribot.core.messages import Path
from agribot.core.robot import DriveSpec

TURN_YAW_RATE_RADPS = 0.6  # yaw rate at which the inner wheels of a tight turn still roll forwards
RAMP_MPS2 = 0.3  # gentle for the soil, and far below what the drive can brake
CREEP_MPS = 0.05  # least speed, which ends the approach to the end of the path
MAX_ROW_CURVATURE_RADPM = 0.25  # largest curvature of a row; a larger one is a turn
_SETTLED_BEFORE_M = 0.1  # the drive lags: be slow already where the turn begins


def find_most_mps(safety: SafetyConfig, drive: DriveSpec) -> float:
    """Find the speed beyond which the supervisor slows a command down."""
    return min(safety.max_speed_mps, drive.max_speed_mps)


def limit_speeds(config: MissionConfig, most_mps: float) -> MissionConfig:
    """Keep the speeds of a mission within what the robot may drive."""
    return msgspec.structs.replace(
        config,
        speed_mps=min(config.speed_mps, most_mps),
        turn_speed_mps=min(config.turn_speed_mps, most_mps),
    )


def warn_of_speeds(config: MissionConfig, most_mps: float) -> tuple[str, ...]:
    """Say which speeds of a mission are more than the robot may drive."""
    asked = {"speed_mps": config.speed_mps, "turn_speed_mps": config.turn_speed_mps}
    return tuple(
        f"mission.{name}: {speed_mps:g} m/s is more than this robot may drive, so it drives "
        f"{most_mps:g} m/s; set less, or raise safety.max_speed_mps or the drive's max_speed_mps"
        for name, speed_mps in asked.items()
        if speed_mps > most_mps
    )


def time_left_s(path: Path, speed_mps: Sequence[float]) -> Sequence[float]:
    """Count the time from each point to the end at the planned speeds, turns in place included."""
    step_m = np.diff(path.s_m)
    turned_rad = np.abs(np.angle(np.exp(1j * np.diff(path.yaw_map_rad))))
    mean_mps = (np.array(speed_mps)[1:] + np.array(speed_mps)[:-1]) / 2.0
    step_s = np.where(step_m > 0.0, step_m / mean_mps, turned_rad / TURN_YAW_RATE_RADPS)
    return view_floats(np.concatenate([np.cumsum(step_s[::-1])[::-1], [0.0]]))


def find_pivots(path: Path) -> list[int]:
    """Find the points where the robot turns in place, or back: the next one is the same place."""
    stands: list[int] = np.flatnonzero(np.diff(path.s_m) <= 0.0).tolist()
    return stands


def plan_speed_mps(path: Path, config: MissionConfig) -> Sequence[float]:
    """Plan the speed limit at each point: slower in turns and backwards, ramped to the end."""
    curvature = np.abs(path.curvature_radpm)
    ahead = np.searchsorted(path.s_m, path.s_m + _SETTLED_BEFORE_M)
    bend_after = np.concatenate([[0], np.cumsum(curvature > MAX_ROW_CURVATURE_RADPM)])
    is_turn = bend_after[np.minimum(ahead + 1, len(curvature))] > bend_after[:-1]
    in_turn = np.minimum(config.turn_speed_mps, TURN_YAW_RATE_RADPS / np.maximum(curvature, 1e-9))
    is_turn |= is_backwards(path.xy_map_m, path.yaw_map_rad)
    cap = np.where(is_turn, np.minimum(config.speed_mps, in_turn), config.speed_mps)
    stands = np.array(find_pivots(path), dtype=np.int64)
    cap[np.concatenate([stands, stands + 1, [-1]])] = CREEP_MPS
    # Growth of the squared speed per metre, away from every slower place.
    gained = 2.0 * RAMP_MPS2 * path.s_m
    square = cap**2 + gained
    square = np.minimum.accumulate(square[::-1])[::-1] - 2.0 * gained
    square = np.minimum.accumulate(square) + gained
    return view_floats(np.where(square < cap**2 - 1e-9, np.sqrt(square), cap))
