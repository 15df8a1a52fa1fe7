"""The robot of a run as its settings complete it."""

from __future__ import annotations

from agribot.core.config import RunConfig
from agribot.core.robot import RobotSpec
from agribot.description.lidar import fit_lidar
from agribot.description.loader import load_robot


def load_robot_of_run(config: RunConfig) -> RobotSpec:
    """Read the robot of the settings, with the lidar that they may add to it.

    Raises: DescriptionError: as `load_robot`.
    """
    robot = load_robot(config.robot)
    return fit_lidar(robot) if config.sim.lidar else robot
