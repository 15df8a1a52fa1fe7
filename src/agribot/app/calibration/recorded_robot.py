"""The robot of a recording, corrected by what had been measured of it."""

from __future__ import annotations

from pathlib import Path

from agribot.app.calibration.measured_robot import apply_calibration
from agribot.core.config import RunConfig
from agribot.core.robot import RobotSpec
from agribot.description.loader import parse_robot
from agribot.record.replay import read_urdf


def read_measured_robot(path: Path, config: RunConfig) -> RobotSpec:
    """Read the robot of the recording whose settings are `config`."""
    return apply_calibration(parse_robot(read_urdf(path), "recorded robot"), config.calibration)
