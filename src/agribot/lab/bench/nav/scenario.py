"""The scenario: field, robot, errors of soil and sensors. Numbers in SI units."""

from __future__ import annotations

import math
from typing import Any, Literal

import msgspec

from agribot.core.config import (
    FieldConfig,
    MissionConfig,
    RunConfig,
    SimConfig,
    assign,
    from_tree,
)
from agribot.core.geo import Datum

Variant = Literal["nominal", "hard"]
# Measurements replaced by the truth, to find the sensor that makes a mission fail.
Perfect = Literal["fixes", "heading"]

DT_S = 0.01
TICK_STEPS = 2  # the robot ticks at 50 Hz
TICK_S = TICK_STEPS * DT_S
ROWS, ROW_LENGTH_M, PITCH_M, SPACING_M = 10, 12.0, 1.0, 0.25
PLANTS = round(ROW_LENGTH_M / SPACING_M) + 1
HEADLAND_M = 1.0
WHEELS_BODY_M = ((0.25, 0.39), (0.25, -0.39), (-0.25, 0.39), (-0.25, -0.39))
CRUSH_M = 0.09  # wheel centre to plant centre
ROW_LIMIT_M = 0.25  # cross-track error beyond which a row is lost
MAX_TIME_S = 1800.0
START_STD_M, START_STD_RAD = 0.05, math.radians(2.0)


class SoilDrift(msgspec.Struct, frozen=True, kw_only=True):
    """Effects of the ground on the drive; sigma and memory of each."""

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
    stated_ratio: float = 1.0  # stated noise over true noise


class Scenario(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the table.

    `sensors` is a preset of the simulator; `settings`, such as `mission.max_row_std_m=0.2`, change
    the robot.
    """

    sensors: str = "m8n"
    vision: Vision | None = Vision()
    soil: SoilDrift = SoilDrift()
    variant: Variant = "nominal"
    speed_mps: float = 0.8
    rows: int = ROWS
    settings: tuple[str, ...] = ()
    perfect: tuple[Perfect, ...] = ()

    @property
    def name(self) -> str:
        seen = " + vision" if self.vision else ""
        rows = "" if self.rows == ROWS else f", {self.rows} rows"
        extras = [f"perfect {sensor}" for sensor in self.perfect]
        changed = "".join(f", {change}" for change in (*self.settings, *extras))
        return f"{self.sensors}{seen}, {self.speed_mps:g} m/s, {self.variant}{rows}{changed}"

    def config(self, seed: int) -> RunConfig:
        """Make the settings of one robot.

        Raises: ConfigError: one of the `settings` is unknown, or out of range.
        """
        tree: dict[str, Any] = msgspec.to_builtins(
            RunConfig(
                seed=seed,
                sim=SimConfig(sensors=self.sensors),
                field=self._field(),
                mission=self._mission(),
            )
        )
        for setting in self.settings:
            assign(tree, setting)
        return from_tree(tree, "--set")

    def _field(self) -> FieldConfig:
        """Rows drilled from South to North in the map, as configured on the robot."""
        return FieldConfig(
            datum=Datum(lat_deg=0.0, lon_deg=0.0),
            first_row_start_map_m=(0.0, (self.rows - 1) * PITCH_M),
            row_yaw_deg=0.0, row_length_m=ROW_LENGTH_M, row_pitch_m=PITCH_M, row_count=self.rows,
            row_map_std_m=0.0,  # its rows are exact
            start_map_m=(-HEADLAND_M, 0.0), start_yaw_deg=0.0, start_std_m=START_STD_M,
            start_yaw_std_deg=math.degrees(START_STD_RAD),
        )  # fmt: skip

    def _mission(self) -> MissionConfig:
        """Pause where the robot knows the row too badly, and creep before."""
        return MissionConfig(
            speed_mps=self.speed_mps, turn_speed_mps=0.3, headland_m=HEADLAND_M,
            full_speed_std_m=0.05, max_row_std_m=0.12,
        )  # fmt: skip


def make_scenario(
    sensors: str, *, vision: bool, speed_mps: float = 0.8, variant: Variant = "nominal"
) -> Scenario:
    """Choose soil and camera for a line of the table."""
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
        sensors=sensors, vision=seen if vision else None, soil=soil, variant=variant,
        speed_mps=speed_mps,
    )  # fmt: skip
