"""Missions of many seeds at once: plant, sensors, the robot's filter and follower, judge."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from agribot.autonomy.plan.caution import protection_limit_m
from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.batch.compass import BatchYaw
from agribot.lab.bench.nav.batch.gnss import BatchFix
from agribot.lab.bench.nav.batch.localizer import BatchHeading, BatchLocalizer
from agribot.lab.bench.nav.batch.row_lines import BatchLine
from agribot.lab.bench.nav.driving import BatchDriving
from agribot.lab.bench.nav.judge import NEES_PERIOD_S, FleetJudge, LevelJudge, Outcome
from agribot.lab.bench.nav.plant import Proprioception, RoverFleet
from agribot.lab.bench.nav.receivers import Compasses, Receivers
from agribot.lab.bench.nav.row_camera import PERIOD_STEPS, RowCamera
from agribot.lab.bench.nav.scenario import DT_S, MAX_TIME_S, PITCH_M, ROWS, TICK_STEPS, Scenario

MAG_STEPS = 20
Reading = BatchYaw | BatchFix | BatchHeading | BatchLine
Stop = Callable[[], bool]


class Arrivals:
    """Readings on their way from the sensor to the stack."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, int, Reading]] = []
        self._order = itertools.count()

    def send(self, at_s: float, reading: Reading) -> None:
        heapq.heappush(self._waiting, (at_s, next(self._order), reading))

    def until(self, t_s: float) -> list[Reading]:
        arrived = []
        while self._waiting and self._waiting[0][0] <= t_s + 1e-9:
            arrived.append(heapq.heappop(self._waiting)[2])
        return arrived


class Sensors:
    """All sensors of all robots; `read` gives what has arrived by a tick."""

    def __init__(self, seeds: Sequence[int], scenario: Scenario, robot: RobotSpec) -> None:
        gnss, vision = scenario.gnss, scenario.vision
        x_m, y_m, _ = robot.body_from_link(robot.gnss.link)[:3, 3].tolist()
        self._gnss, self._vision = gnss, vision
        self._own = Proprioception(seeds)
        self._compasses = Compasses(seeds, is_hector=scenario.gnss.hector_drift_m > 0.0)
        self._receivers = Receivers(seeds, gnss, (x_m, y_m))
        self._camera = None if vision is None else RowCamera(seeds, vision)
        self._arrivals = Arrivals()
        self._wheel_m, self._turn_rad = np.zeros((2, len(seeds)))

    def step(self, k: int, plant: RoverFleet) -> None:
        """Sample at step `k`, after the plant has moved."""
        t_s = k * DT_S
        wheel_mps, rate_radps = self._own.read(plant)
        self._wheel_m = self._wheel_m + wheel_mps * DT_S
        self._turn_rad = self._turn_rad + rate_radps * DT_S
        if k % MAG_STEPS == 0:
            self._arrivals.send(t_s, BatchYaw(t_s, self._compasses.sample(plant)))
        if k % self._gnss.period_steps == 0:
            fix, heading = self._receivers.sample(t_s, plant)
            self._arrivals.send(t_s + self._gnss.latency_s, fix)
            if heading is not None:
                self._arrivals.send(t_s + self._gnss.latency_s, heading)
        if self._camera is not None and self._vision and k % PERIOD_STEPS == 0:
            line = self._camera.sample(t_s, plant)
            self._arrivals.send(t_s + self._vision.latency_s, line)

    def read(self, t_s: float) -> tuple[FloatArray, FloatArray, list[Reading]]:
        """Distance and turn since the last tick, and what else arrived."""
        distance_m, turn_rad = self._wheel_m, self._turn_rad
        self._wheel_m, self._turn_rad = np.zeros((2, len(distance_m)))
        return distance_m, turn_rad, self._arrivals.until(t_s)


def run_missions(
    seeds: Sequence[int],
    scenario: Scenario,
    robot: RobotSpec,
    stop: Stop = lambda: False,
    *,
    has_level: bool = False,
) -> list[Outcome]:
    """Drive every seed until it has finished or its time is over.

    With `has_level` the protection level is worked out and judged as well.
    """
    count = len(seeds)
    plant, sensors = RoverFleet(seeds, scenario.soil), Sensors(seeds, scenario, robot)
    localizer = BatchLocalizer(
        count, scenario.estimate(), scenario.field(), robot,
        is_corrected=scenario.gnss.is_corrected,
    )  # fmt: skip
    driving, judge = BatchDriving(count, scenario, robot), FleetJudge(count)
    levels = LevelJudge(count, protection_limit_m(robot.drive, PITCH_M))
    tick_s = TICK_STEPS * DT_S
    for k in range(1, round(MAX_TIME_S / DT_S) + 1):
        plant.step(driving.follower.v_mps, driving.follower.yaw_rate_radps)
        sensors.step(k, plant)
        if k % TICK_STEPS:
            continue
        t_s = k * DT_S
        distance_m, turn_rad, readings = sensors.read(t_s)
        localizer.advance(t_s, distance_m, turn_rad / tick_s)
        lines = hear(localizer, readings)
        estimate = localizer.estimate()
        driving.step(t_s, estimate)
        for line in lines:
            localizer.observe_line(line)
        row = np.where(driving.row < 0, -1, ROWS - 1 - driving.row)
        judge.tick(plant, row, driving.tool_on, driving.is_done)
        if has_level and localizer.is_ready:
            levels.tick(plant, estimate.y_map_m, localizer.bound(t_s), row)
        if k % round(NEES_PERIOD_S / DT_S) == 0 and localizer.is_ready:
            judge.check_covariance(
                plant, estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad, estimate.cov, row
            )
        if driving.is_done.all() or stop():
            break
    paused_s = driving.paused_s * tick_s
    found = judge.outcomes(list(seeds), driving.is_done, paused_s, has_filter=True)
    return add_levels(found, levels) if has_level else found


def add_levels(found: Sequence[Outcome], levels: LevelJudge) -> list[Outcome]:
    pairs = zip(found, levels.outcomes(), strict=True)
    return [msgspec.structs.replace(outcome, level=level) for outcome, level in pairs]


def hear(localizer: BatchLocalizer, readings: Sequence[Reading]) -> list[BatchLine]:
    """Hand readings to the filter as the stack does; lines are kept for after the estimate."""
    lines = [reading for reading in readings if isinstance(reading, BatchLine)]
    fixes = [reading for reading in readings if isinstance(reading, BatchFix)]
    headings = [reading for reading in readings if isinstance(reading, BatchHeading)]
    mags = [reading for reading in readings if isinstance(reading, BatchYaw)]
    localizer.hear(mags, fixes, headings)
    return lines
