"""The robot that is measured: the program's own filter, mission and follower, tick by tick."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from agribot.autonomy.control.follower import Follower
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.plan.mission.mission import Mission
from agribot.autonomy.plan.tasks.row_task import RowTask
from agribot.core.config import RunConfig
from agribot.core.messages import STOP, DriveCommand, Scene, SensorBatch
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.scenario import TICK_S
from agribot.sim.sensors.presets import load_preset

# States in which a mission goes on by itself.
GOES_ON = ("waiting", "running")


class DrivenRobot:
    """Takes the measurements of a tick, and returns the command of the follower."""

    def __init__(self, config: RunConfig, robot: RobotSpec) -> None:
        self.localizer = Localizer(config.estimate, config.field, robot)
        self.mission = Mission(RowTask(config, robot), config.mission)
        self._follower = Follower(config.control, robot)
        self.estimate = self.localizer.update(SensorBatch(t_s=0.0))
        self.goal = self.mission.step(self.estimate)

    def tick(self, batch: SensorBatch, scenes: Sequence[Scene] = ()) -> DriveCommand:
        """Estimate, plan and steer, in the order of `agribot.autonomy.stack.Stack.tick`."""
        self.estimate = self.localizer.update(batch)
        for scene in scenes:
            if not self.localizer.is_stale(scene):
                self.localizer.observe(scene)
        on_path = self.mission.relate_to_path(self.estimate)
        self.goal = self.mission.step(on_path)
        command, _ = self._follower.step(on_path, self.goal, TICK_S)
        return command if self.goes_on else STOP

    @property
    def goes_on(self) -> bool:
        return self.goal.status.state in GOES_ON

    @property
    def is_done(self) -> bool:
        return self.goal.status.state == "done"


def equip(robot: RobotSpec, sensors: str) -> RobotSpec:
    """Take the magnetometer off a robot whose preset has none.

    Raises: ConfigError: no preset has this name.
    """
    has_mag = load_preset(sensors).mag != "none"
    return robot if has_mag else msgspec.structs.replace(robot, mag=None)
