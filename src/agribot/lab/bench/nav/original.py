"""The original robot's controller on the same soil, sensors and judge.

It steers at the next waypoint with a PD law (0.01 and 0.5 per degree) on the median of seven
compass samples and the raw GNSS position, goes 0.4 m/s straight and 0.2 m/s while it corrects,
turns on the spot above 10 degrees, and takes a waypoint as reached within 1 m.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.batch.arrays import clamp
from agribot.lab.bench.nav.batch.compass import BatchYaw
from agribot.lab.bench.nav.batch.gnss import BatchFix
from agribot.lab.bench.nav.judge import FleetJudge, Outcome
from agribot.lab.bench.nav.missions import Sensors, Stop
from agribot.lab.bench.nav.plant import RoverFleet
from agribot.lab.bench.nav.scenario import (
    DT_S,
    HEADLAND_M,
    MAX_TIME_S,
    PITCH_M,
    ROW_LENGTH_M,
    ROWS,
    TICK_STEPS,
    Scenario,
)

GAIN_P, GAIN_D = 0.01, 0.5  # rad/s per degree, and per degree of change between two fixes
STRAIGHT_MPS, CORRECTING_MPS, MAX_RADPS = 0.4, 0.2, 0.5
STRAIGHT_DEG, PIVOT_DEG = 2.0, 10.0
ARRIVED_M, MEDIAN_SAMPLES = 1.0, 7


class OriginalController:
    """`v_mps`, `yaw_rate_radps` change with every fix; `waypoint` counts the row ends."""

    def __init__(self, count: int) -> None:
        self.v_mps, self.yaw_rate_radps = np.zeros((2, count))
        self.waypoint = np.ones(count, dtype=np.int64)
        self.is_done = np.zeros(count, dtype=bool)
        self._heading_deg, self._angle_deg = np.zeros((2, count))
        self._window: list[FloatArray] = []
        ends = (-HEADLAND_M, ROW_LENGTH_M + HEADLAND_M)
        self._at_m = np.array(
            [(ends[(row + end) % 2], row * PITCH_M) for row in range(ROWS) for end in (0, 1)]
        )

    def hear_compass(self, yaw_rad: FloatArray) -> None:
        """Windows do not overlap, and the median is taken of wrapped degrees."""
        self._window.append(np.degrees(yaw_rad))
        if len(self._window) == MEDIAN_SAMPLES:
            self._heading_deg = np.median(self._window, axis=0)
            self._window.clear()

    def hear_fix(self, east_m: FloatArray, north_m: FloatArray) -> None:
        goal_m = self._at_m[np.minimum(self.waypoint, len(self._at_m) - 1)]
        dx, dy = goal_m[:, 0] - east_m, goal_m[:, 1] - north_m
        angle_deg = np.degrees(np.arctan2(dy, dx)) - self._heading_deg
        angle_deg = np.where(angle_deg > 180.0, angle_deg - 360.0, angle_deg)
        angle_deg = np.where(angle_deg < -180.0, angle_deg + 360.0, angle_deg)
        change_deg, self._angle_deg = angle_deg - self._angle_deg, angle_deg
        arrives = np.hypot(dx, dy) <= ARRIVED_M
        rate = clamp(GAIN_P * angle_deg + GAIN_D * change_deg, -MAX_RADPS, MAX_RADPS)
        straight = abs(angle_deg) < STRAIGHT_DEG
        speed = np.where(abs(angle_deg) > PIVOT_DEG, 0.0, CORRECTING_MPS)
        self.waypoint = self.waypoint + (arrives & ~self.is_done)
        self.is_done |= self.waypoint >= len(self._at_m)
        halts = arrives | self.is_done
        self.v_mps = np.where(halts, 0.0, np.where(straight, STRAIGHT_MPS, speed))
        self.yaw_rate_radps = np.where(halts | straight, 0.0, rate)

    @property
    def row(self) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        """The row it drives along, -1 on the way to the next."""
        return np.where((self.waypoint % 2 == 1) & ~self.is_done, self.waypoint // 2, -1)


def run_original(
    seeds: Sequence[int], scenario: Scenario, robot: RobotSpec, stop: Stop = lambda: False
) -> list[Outcome]:
    """GNSS is compared with goals in the true map, as after a start at a known place."""
    count = len(seeds)
    plant, sensors = RoverFleet(seeds, scenario.soil), Sensors(seeds, scenario, robot)
    controller, judge = OriginalController(count), FleetJudge(count)
    for k in range(1, round(MAX_TIME_S / DT_S) + 1):
        plant.step(controller.v_mps, controller.yaw_rate_radps)
        sensors.step(k, plant)
        if k % TICK_STEPS:
            continue
        for reading in sensors.read(k * DT_S)[2]:
            if isinstance(reading, BatchFix):
                controller.hear_fix(reading.east_m, reading.north_m)
            elif isinstance(reading, BatchYaw):
                controller.hear_compass(reading.yaw_map_rad)
        row = controller.row
        judge.tick(plant, row, row >= 0, controller.is_done)
        if controller.is_done.all() or stop():
            break
    return judge.outcomes(list(seeds), controller.is_done, np.zeros(count), has_filter=False)
