"""The scenario: field, robot, errors of soil and sensors. Numbers in SI units."""

from __future__ import annotations

import math
from typing import Literal

import msgspec
import numpy as np

from agribot.core.config import (
    ControlConfig,
    EstimateConfig,
    FieldConfig,
    MissionConfig,
)
from agribot.core.geo import Datum

Receiver = Literal["legacy", "hector", "m8n", "rtk", "rtk-dual"]
# Presets of the simulator on a robot without a magnetometer; the stack itself drives them.
Preset = Literal["rtk-1", "m8n-1", "m8n-urban", "rtk-trees"]
Variant = Literal["nominal", "hard"]

DT_S = 0.01
TICK_STEPS = 2  # the stack ticks at 50 Hz
ROWS, ROW_LENGTH_M, PITCH_M, SPACING_M = 10, 12.0, 1.0, 0.25
PLANTS = round(ROW_LENGTH_M / SPACING_M) + 1
HEADLAND_M = 1.0
WHEELS_BODY_M = ((0.25, 0.39), (0.25, -0.39), (-0.25, 0.39), (-0.25, -0.39))
CRUSH_M = 0.09  # wheel centre to plant centre
ROW_LIMIT_M = 0.25  # a row is lost beyond this cross-track error
AREA_M2 = ROWS * ROW_LENGTH_M * PITCH_M
MAX_TIME_S = 1800.0
START_STD_M, START_STD_RAD = 0.05, math.radians(2.0)


class SoilDrift(msgspec.Struct, frozen=True, kw_only=True):
    """What the ground does to the drive; sigma and memory of each."""

    slip_max_ratio: float = 0.06
    slip_std_ratio: float = 0.02
    yaw_gain_std_ratio: float = 0.08
    yaw_gain_walk_ratio: float = 0.05
    yaw_rate_std_radps: float = math.radians(2.0)
    slope_max_rad: float = math.radians(2.0)
    lateral_std_mps: float = 0.01
    turn_centre_std_m: float = 0.03


class Vision(msgspec.Struct, frozen=True, kw_only=True):
    """A row line 14 times a second; its offset also wanders by 0.8 of its noise over 2 s."""

    offset_std_m: float = 0.015
    heading_std_rad: float = math.radians(0.7)
    heading_wander_rad: float = math.radians(0.3)
    outlier_ratio: float = 0.01
    outlier_m: float = 0.3
    outlier_rad: float = math.radians(8.0)
    dropout_max_s: float = 1.5
    dropout_min_s: float = 0.2
    dropout_every_s: float = 20.0
    latency_s: float = 0.08
    range_std_m: float = 0.1
    stated_ratio: float = 1.0  # what it says of its noise, over its noise


class GnssErrors(msgspec.Struct, frozen=True, kw_only=True):
    """A receiver: white noise, wanders (sigma, memory), what it says of itself."""

    period_steps: int
    latency_s: float
    white_m: float
    wanders: tuple[tuple[float, float], ...]
    velocity_std_mps: float
    stated_m: float
    is_corrected: bool = False
    hector_drift_m: float = 0.0  # of hector_gazebo's integrator instead of the wanders
    velocity_stated_mps: float | None = None  # where it is not that of its noise
    heading_std_rad: float | None = None


RECEIVERS: dict[Receiver, GnssErrors] = {
    "hector": GnssErrors(
        period_steps=20, latency_s=0.0, white_m=0.1, wanders=(), velocity_std_mps=0.1,
        stated_m=5.0, hector_drift_m=5.0,
    ),
    "m8n": GnssErrors(
        period_steps=20, latency_s=0.15, white_m=0.05, wanders=((1.2, 400.0), (0.25, 30.0)),
        velocity_std_mps=0.05, stated_m=1.5,
    ),
    "rtk": GnssErrors(
        period_steps=10, latency_s=0.1, white_m=0.008, wanders=((0.01, 60.0),),
        velocity_std_mps=0.03, stated_m=0.014, is_corrected=True,
    ),
}  # fmt: skip
_RTK = RECEIVERS["rtk"]
# What the original simulation ran with: its tags for noise were misspelt, the drift remained.
RECEIVERS["legacy"] = msgspec.structs.replace(
    RECEIVERS["hector"], white_m=0.0, velocity_std_mps=0.0, velocity_stated_mps=0.01
)
RECEIVERS["rtk-dual"] = msgspec.structs.replace(_RTK, heading_std_rad=math.radians(0.4))


class Scenario(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the table."""

    receiver: Literal[Receiver, Preset] = "m8n"
    vision: Vision | None = Vision()
    soil: SoilDrift = SoilDrift()
    variant: Variant = "nominal"
    speed_mps: float = 0.8

    @property
    def is_of_stack(self) -> bool:
        """Whether the stack itself drives each robot, not the batch that follows its formulas."""
        return self.receiver not in RECEIVERS

    @property
    def gnss(self) -> GnssErrors:
        """Errors of a receiver of the batch."""
        return RECEIVERS[self.receiver]  # type: ignore[index]

    @property
    def name(self) -> str:
        seen = " + vision" if self.vision else ""
        return f"{self.receiver}{seen}, {self.speed_mps:g} m/s, {self.variant}"

    def field(self) -> FieldConfig:
        """Rows drilled from South to North in the map, as the robot is told them."""
        return FieldConfig(
            datum=Datum(lat_deg=0.0, lon_deg=0.0),
            first_row_start_map_m=(0.0, (ROWS - 1) * PITCH_M),
            row_yaw_deg=0.0, row_length_m=ROW_LENGTH_M, row_pitch_m=PITCH_M, row_count=ROWS,
            row_map_std_m=0.0,  # its rows are exact
            start_map_m=(-HEADLAND_M, 0.0), start_yaw_deg=0.0, start_std_m=START_STD_M,
            start_yaw_std_deg=math.degrees(START_STD_RAD),
        )  # fmt: skip

    def mission(self) -> MissionConfig:
        """Pause where the robot knows the row too badly, and creep before."""
        return MissionConfig(
            speed_mps=self.speed_mps, turn_speed_mps=0.3, headland_m=HEADLAND_M,
            full_speed_std_m=0.05, max_row_std_m=0.12,
        )  # fmt: skip

    def estimate(self) -> EstimateConfig:
        # Its compass tells angles, no fields, and its soil takes no way in turns.
        return EstimateConfig(mag_learn=False, max_turn_loss_ratio=0.0)

    def control(self) -> ControlConfig:
        return ControlConfig()


def scenario(
    receiver: Literal[Receiver, Preset], *, vision: bool, speed_mps: float, variant: Variant
) -> Scenario:
    soil, seen = SoilDrift(), Vision()
    if variant == "hard":
        soil = SoilDrift(
            slip_max_ratio=0.12, slip_std_ratio=0.04, yaw_gain_std_ratio=0.16,
            yaw_gain_walk_ratio=0.1, yaw_rate_std_radps=math.radians(4.0),
            slope_max_rad=math.radians(4.0),
        )  # fmt: skip
        seen = Vision(
            offset_std_m=0.04, heading_std_rad=math.radians(2.0), outlier_ratio=0.1,
            dropout_max_s=10.0, latency_s=0.2,
        )  # fmt: skip
    return Scenario(
        receiver=receiver, vision=seen if vision else None, soil=soil, variant=variant,
        speed_mps=speed_mps,
    )  # fmt: skip


def plants_map_m() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """(ROWS, PLANTS, 2)."""
    x_m, y_m = np.meshgrid(np.arange(PLANTS) * SPACING_M, np.arange(ROWS) * PITCH_M)
    return np.stack([x_m, y_m], axis=-1)
