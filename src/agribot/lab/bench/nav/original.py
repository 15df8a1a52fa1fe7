"""The original robot's controller on the same soil, sensors and judge.

It steers at the next waypoint with a PD law (0.01 and 0.5 per degree) on the median of seven
compass samples and the raw GNSS position, goes 0.4 m/s straight and 0.2 m/s while it corrects,
turns on the spot above 10 degrees, and takes a waypoint as reached within 1 m.
"""

from __future__ import annotations

import math
import statistics
import time

import msgspec

from agribot.core.arithmetic import clamp
from agribot.core.geo import MapFrame
from agribot.core.messages import SensorBatch
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.judge import MissionJudge, Outcome
from agribot.lab.bench.nav.missions import Stop
from agribot.lab.bench.nav.plant import SoilRover
from agribot.lab.bench.nav.scenario import (
    DT_S,
    HEADLAND_M,
    MAX_TIME_S,
    PITCH_M,
    ROW_LENGTH_M,
    TICK_STEPS,
    Scenario,
)
from agribot.lab.bench.nav.sensors import Sensors

GAIN_P, GAIN_D = 0.01, 0.5  # rad/s per degree, and per degree of change between two fixes
STRAIGHT_MPS, CORRECTING_MPS, MAX_RADPS = 0.4, 0.2, 0.5
STRAIGHT_DEG, PIVOT_DEG = 2.0, 10.0
ARRIVED_M, MEDIAN_SAMPLES = 1.0, 7


class OriginalController:
    """`v_mps`, `yaw_rate_radps` change with every fix; `waypoint` counts the row ends."""

    def __init__(self, rows: int, frame: MapFrame) -> None:
        self.v_mps = self.yaw_rate_radps = 0.0
        self.waypoint, self.is_done = 1, False
        self._frame = frame
        self._heading_deg = self._angle_deg = 0.0
        self._window: list[float] = []
        ends = (-HEADLAND_M, ROW_LENGTH_M + HEADLAND_M)
        self._at_m = [
            (ends[(row + end) % 2], row * PITCH_M) for row in range(rows) for end in (0, 1)
        ]

    def update(self, batch: SensorBatch) -> None:
        for sample in batch.mag:
            x, y, _ = sample.field_t
            self.update_compass(math.degrees(math.atan2(x, y)))
        for fix in batch.gnss:
            east_m, north_m, _ = self._frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, fix.alt_m)
            self.update_fix(east_m, north_m)

    def update_compass(self, yaw_deg: float) -> None:
        """Windows do not overlap, and the median is taken of wrapped degrees."""
        self._window.append(yaw_deg)
        if len(self._window) == MEDIAN_SAMPLES:
            self._heading_deg = statistics.median(self._window)
            self._window.clear()

    def update_fix(self, east_m: float, north_m: float) -> None:
        if self.is_done:
            return
        x_m, y_m = self._at_m[self.waypoint]
        dx_m, dy_m = x_m - east_m, y_m - north_m
        angle_deg = math.degrees(math.atan2(dy_m, dx_m)) - self._heading_deg
        if angle_deg > 180.0:
            angle_deg -= 360.0
        if angle_deg < -180.0:
            angle_deg += 360.0
        change_deg, self._angle_deg = angle_deg - self._angle_deg, angle_deg
        if math.hypot(dx_m, dy_m) <= ARRIVED_M:
            self._arrive()
        else:
            self._steer(angle_deg, change_deg)

    def _arrive(self) -> None:
        self.v_mps = self.yaw_rate_radps = 0.0
        self.waypoint += 1
        self.is_done = self.waypoint >= len(self._at_m)

    def _steer(self, angle_deg: float, change_deg: float) -> None:
        if abs(angle_deg) < STRAIGHT_DEG:
            self.v_mps, self.yaw_rate_radps = STRAIGHT_MPS, 0.0
            return
        rate_radps = GAIN_P * angle_deg + GAIN_D * change_deg
        self.yaw_rate_radps = clamp(rate_radps, -MAX_RADPS, MAX_RADPS)
        self.v_mps = 0.0 if abs(angle_deg) > PIVOT_DEG else CORRECTING_MPS

    @property
    def row(self) -> int:
        """The row it drives along, -1 on the way to the next."""
        return self.waypoint // 2 if self.waypoint % 2 == 1 and not self.is_done else -1


def run_original(
    seed: int, scenario: Scenario, robot: RobotSpec, stop: Stop = lambda: False
) -> Outcome:
    """GNSS is compared with goals in the true map, as after a start at a known place.

    Raises: ConfigError: the scenario's sensors or settings are not valid.
    """
    began_s, config = time.process_time(), scenario.config(seed)
    rover, sensors = SoilRover(seed, scenario.soil), Sensors(config, robot)
    controller = OriginalController(scenario.rows, MapFrame(config.field.datum))
    judge = MissionJudge(scenario.rows)
    for k in range(1, round(MAX_TIME_S / DT_S) + 1):
        rover.step(controller.v_mps, controller.yaw_rate_radps)
        sensors.step(rover)
        if k % TICK_STEPS:
            continue
        controller.update(sensors.read())
        judge.tick(rover, controller.row, tool_on=controller.row >= 0)
        if controller.is_done or stop():
            break
    outcome = judge.outcome(seed, is_done=controller.is_done)
    return msgspec.structs.replace(outcome, cpu_s=time.process_time() - began_s)
