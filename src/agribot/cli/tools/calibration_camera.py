"""A simulated drive for `agribot calibrate camera` and `row-view`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import msgspec

from agribot.core import config as settings
from agribot.core.messages import Scene, SensorBatch
from agribot.core.robot import RobotSpec
from agribot.description.worlds_sdf import load_world

if TYPE_CHECKING:
    from agribot.app.calibration.camera import CameraDrive

DRIVE_S = 75.0


def observe_drive(
    robot: RobotSpec, machine: RobotSpec, profile: str, sensors: str, seed: int
) -> CameraDrive:
    """Drive the first minutes of a profile's mission, with the camera as the machine has it."""
    from agribot.app.calibration.camera import observe_ticks
    from agribot.app.robot_stack import build_stack
    from agribot.sim.platform import SimPlatform

    names = (f"sim.sensors={format_toml(sensors)}", f"seed={format_toml(seed)}")
    config = settings.load(profile, names)
    world = load_world(config.world, seed=seed)
    platform = SimPlatform(config, machine, world, board=robot.drive)
    stack = build_stack(config, robot)

    def ticks() -> Iterable[tuple[SensorBatch, tuple[Scene, ...]]]:
        while True:
            tick = stack.tick(platform)
            yield tick.batch, tick.scenes
            if tick.batch.t_s >= DRIVE_S:
                return

    try:
        return observe_ticks(ticks(), robot, config)
    finally:
        platform.close()
        stack.close()


def format_toml(value: str | int) -> str:
    return msgspec.json.encode(value).decode()
