"""One mission: plant, sensors, the robot and its judge."""

from __future__ import annotations

import time
from collections.abc import Callable

import msgspec

from agribot.autonomy.plan.mission.caution import protection_limit_m
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.judge import (
    NEES_PERIOD_S,
    Consistency,
    LevelJudge,
    MissionJudge,
    Outcome,
)
from agribot.lab.bench.nav.plant import SoilRover
from agribot.lab.bench.nav.robot import DrivenRobot, equip
from agribot.lab.bench.nav.scenario import (
    DT_S,
    MAX_TIME_S,
    PITCH_M,
    TICK_S,
    TICK_STEPS,
    Scenario,
)
from agribot.lab.bench.nav.sensors import Eyes, Sensors

Stop = Callable[[], bool]
NEES_TICKS = round(NEES_PERIOD_S / TICK_S)


def run_mission(
    seed: int, scenario: Scenario, robot: RobotSpec, stop: Stop = lambda: False
) -> Outcome:
    """Drive one seed until its mission has ended, or waits for a person.

    Raises: ConfigError: the scenario's sensors or settings are not valid.
    """
    began_s = time.process_time()
    config, robot = scenario.config(seed), equip(robot, scenario.sensors)
    rover, eyes = SoilRover(seed, scenario.soil), Eyes(seed, scenario)
    sensors = Sensors(config, robot, scenario.perfect)
    driver, trial = DrivenRobot(config, robot), MissionTrial(scenario, robot)
    v_mps = yaw_rate_radps = 0.0
    for k in range(1, round(MAX_TIME_S / DT_S) + 1):
        rover.step(v_mps, yaw_rate_radps)
        sensors.step(rover)
        eyes.step(k, rover)
        if k % TICK_STEPS:
            continue
        command = driver.tick(sensors.read(), eyes.take(k * DT_S))
        v_mps, yaw_rate_radps = command.v_mps, command.yaw_rate_radps
        trial.tick(rover, driver)
        if not driver.goes_on or stop():
            break
    return msgspec.structs.replace(trial.outcome(seed, driver), cpu_s=time.process_time() - began_s)


class MissionTrial:
    """Everything that is measured of a robot of ours."""

    def __init__(self, scenario: Scenario, robot: RobotSpec) -> None:
        self._rows = scenario.rows
        self._judge, self._consistency = MissionJudge(scenario.rows), Consistency()
        self._level = LevelJudge(protection_limit_m(robot.drive, PITCH_M))
        self._ticks = self._paused = 0

    def tick(self, rover: SoilRover, driver: DrivenRobot) -> None:
        self._ticks += 1
        goal, estimate = driver.goal, driver.estimate
        self._paused += goal.max_speed_mps == 0.0
        if not driver.goes_on:
            return
        # The mission counts from the row that it works first, in the North.
        row = -1 if goal.status.row < 0 else self._rows - 1 - goal.status.row
        self._judge.tick(rover, row, tool_on=goal.tool_on)
        if row >= 0:
            self._level.tick(rover, estimate.y_map_m, estimate.across_protection_m, row)
            if self._ticks % NEES_TICKS == 0:
                self._consistency.add(rover, estimate)

    def outcome(self, seed: int, driver: DrivenRobot) -> Outcome:
        nees, nees_pose = self._consistency.means()
        return msgspec.structs.replace(
            self._judge.outcome(seed, is_done=driver.is_done), nees=nees, nees_pose=nees_pose,
            paused_s=self._paused * TICK_S, level=self._level.outcome(),
            reason="" if driver.is_done else driver.goal.status.reason,
        )  # fmt: skip
