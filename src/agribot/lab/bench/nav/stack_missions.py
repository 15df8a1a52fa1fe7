"""Missions whose robots the stack itself drives, with the receivers of the simulator's presets.

A mission costs some CPU seconds where one of the batch costs some hundredths.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.autonomy.plan.caution import protection_limit_m
from agribot.autonomy.plan.tasks.row_task import RowTask
from agribot.core.config import RunConfig
from agribot.core.messages import FloatArray, GnssFix, RowLine
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.judge import NEES_PERIOD_S, FleetJudge, LevelJudge, Outcome
from agribot.lab.bench.nav.missions import Stop, add_levels
from agribot.lab.bench.nav.plant import Proprioception, RoverFleet
from agribot.lab.bench.nav.preset_receivers import PresetReceivers
from agribot.lab.bench.nav.row_camera import PERIOD_STEPS, RowCamera
from agribot.lab.bench.nav.scenario import DT_S, MAX_TIME_S, PITCH_M, ROWS, TICK_STEPS, Scenario
from agribot.lab.bench.nav.stack_robot import TICK_S, StackRobot, pick_line

# States in which a mission goes on by itself.
GOES_ON = ("waiting", "running")


class StackSensors:
    """Wheels, gyro, receiver and camera of all robots, and what is on its way to them."""

    def __init__(self, seeds: Sequence[int], scenario: Scenario, robot: RobotSpec) -> None:
        count, self._vision = len(seeds), scenario.vision
        self._own = Proprioception(seeds)
        self._receivers = PresetReceivers(seeds, scenario, robot)
        self._camera = None if scenario.vision is None else RowCamera(seeds, scenario.vision)
        self._late: list[tuple[float, Sequence[RowLine]]] = []
        self.distance_m, self.turn_rad, self.wheels_turned_rad = np.zeros((3, count))

    def restart_tick(self) -> None:
        self.distance_m, self.turn_rad, self.wheels_turned_rad = np.zeros((3, len(self.turn_rad)))

    def step(self, k: int, plant: RoverFleet) -> None:
        """Sample at step `k`, after the plant has moved."""
        wheel_mps, rate_radps = self._own.read(plant)
        self.distance_m += wheel_mps * DT_S
        self.turn_rad += rate_radps * DT_S
        self.wheels_turned_rad += plant.wheel_radps * DT_S
        self._receivers.step(k, plant)
        if self._camera is not None and self._vision and k % PERIOD_STEPS == 0:
            line = self._camera.sample(k * DT_S, plant)
            lines = [pick_line(line, index) for index in range(len(plant.x_m))]
            self._late.append((k * DT_S + self._vision.latency_s, lines))

    def take_fixes(self, t_s: float) -> list[list[GnssFix]]:
        return self._receivers.take(t_s)

    def take_lines(self, t_s: float) -> list[Sequence[RowLine]]:
        """Take what the camera has shown by now: for each picture the lines of all robots."""
        arrived = [lines for at_s, lines in self._late if at_s <= t_s + 1e-9]
        del self._late[: len(arrived)]
        return arrived


class StackFleet:
    """All robots, and what the judge asks of them as arrays."""

    def __init__(self, count: int, scenario: Scenario, robot: RobotSpec) -> None:
        task = RowTask(RunConfig(field=scenario.field(), mission=scenario.mission()), robot)
        self.robots = [StackRobot(scenario, robot, task) for _ in range(count)]
        self.v_mps, self.yaw_rate_radps, self.paused_s = np.zeros((3, count))

    def tick(self, t_s: float, sensors: StackSensors) -> None:
        fixes, pictures = sensors.take_fixes(t_s), sensors.take_lines(t_s)
        for i in np.flatnonzero(self.goes_on).tolist():
            robot = self.robots[i]
            command = robot.tick(
                t_s, float(sensors.distance_m[i]), float(sensors.turn_rad[i]),
                wheels_turned_rad=float(sensors.wheels_turned_rad[i]), gnss=fixes[i],
            )  # fmt: skip
            for lines in pictures:
                robot.see(lines[i])
            stands = not self.goes_on[i]
            self.v_mps[i] = 0.0 if stands else command.v_mps
            self.yaw_rate_radps[i] = 0.0 if stands else command.yaw_rate_radps
            self.paused_s[i] += TICK_S * (robot.goal.max_speed_mps == 0.0)
        sensors.restart_tick()

    @property
    def goes_on(self) -> np.ndarray:
        return np.array([each.goal.status.state in GOES_ON for each in self.robots])

    @property
    def is_done(self) -> np.ndarray:
        return np.array([each.goal.status.state == "done" for each in self.robots])

    @property
    def row(self) -> np.ndarray:
        """Of the judge, which counts from y = 0; -1 between the rows."""
        rows = np.array([each.goal.status.row for each in self.robots])
        return np.where(rows < 0, -1, ROWS - 1 - rows)

    @property
    def tool_on(self) -> np.ndarray:
        return np.array([each.goal.tool_on for each in self.robots])

    @property
    def level_m(self) -> FloatArray:
        """The protection level across the row."""
        return np.array([each.estimate.across_protection_m for each in self.robots])

    def read_pose(self) -> tuple[FloatArray, FloatArray]:
        """East, north and heading, (3, N), and their covariance, (3, 3, N)."""
        told = [each.estimate for each in self.robots]
        poses = np.array([(e.x_map_m, e.y_map_m, e.yaw_map_rad) for e in told])
        covs = np.array([e.pose_cov for e in told]).reshape(-1, 3, 3)
        return poses.T, covs.transpose(1, 2, 0)


def run_stack_missions(
    seeds: Sequence[int],
    scenario: Scenario,
    robot: RobotSpec,
    stop: Stop = lambda: False,
    *,
    has_level: bool = False,
) -> list[Outcome]:
    """Drive every seed until its mission has ended, or waits for a person."""
    bare = msgspec.structs.replace(robot, mag=None)
    plant, sensors = RoverFleet(seeds, scenario.soil), StackSensors(seeds, scenario, bare)
    fleet, judge = StackFleet(len(seeds), scenario, bare), FleetJudge(len(seeds))
    levels = LevelJudge(len(seeds), protection_limit_m(robot.drive, PITCH_M))
    for k in range(1, round(MAX_TIME_S / DT_S) + 1):
        plant.step(fleet.v_mps, fleet.yaw_rate_radps)
        sensors.step(k, plant)
        if k % TICK_STEPS:
            continue
        fleet.tick(k * DT_S, sensors)
        goes_on = fleet.goes_on
        row = np.where(goes_on, fleet.row, -1)
        judge.tick(plant, row, fleet.tool_on, ~goes_on)
        pose, cov = fleet.read_pose()
        if k % round(NEES_PERIOD_S / DT_S) == 0:
            judge.check_covariance(plant, pose[0], pose[1], pose[2], cov, row)
        if has_level:
            levels.tick(plant, pose[1], fleet.level_m, row)
        if not goes_on.any() or stop():
            break
    found = judge.outcomes(list(seeds), fleet.is_done, fleet.paused_s, has_filter=True)
    return add_levels(found, levels) if has_level else found
