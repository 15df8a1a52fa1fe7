"""The world of a simulated run and the robot in it, as the seed draws them from a preset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from agribot.app.calibration.measured_robot import apply_calibration
from agribot.autonomy.plan.rows import lay_rows
from agribot.core.config import CalibrationConfig, RunConfig
from agribot.core.geo import rotation_from_rpy, rpy_from_rotation
from agribot.core.messages import PlantClass, Row
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.description.altered_world import alter_world
from agribot.description.conditions import Conditions, draw_conditions, load_condition_preset
from agribot.description.sowing import leave_out_crop
from agribot.description.worlds_sdf import load_run_world
from agribot.sim.faults.schedule import parse_fault
from agribot.sim.random_streams import make_stream


class RunWorld(NamedTuple):
    """The true world and what was drawn of it; None where it is as its file says."""

    world: WorldSpec
    conditions: Conditions | None

    def find_true_row(self, row: Row) -> Row:
        """Return the line that the plants of a row of the map truly stand about."""
        return row if self.conditions is None else self.conditions.find_true_row(row)

    def alter_robot(self, robot: RobotSpec) -> RobotSpec:
        """Return the robot with the errors of its camera's mount and the wear of its wheels."""
        return robot if self.conditions is None else _alter_robot(robot, self.conditions)


def make_run_world(config: RunConfig) -> RunWorld:
    """Load the world of the settings and draw what its seed makes of it.

    Raises: AgribotError: unknown preset, or a world or field that cannot be read.
    """
    preset = load_condition_preset(config.sim.preset)
    world = load_run_world(config)
    if preset.is_exact and not config.faults:
        return RunWorld(world, None)
    has_crops = any(plant.plant == PlantClass.CROP for plant in world.plants)
    rows = lay_rows(config.field) if has_crops else ()
    if preset.is_exact:
        return RunWorld(_leave_out_crop(world, rows, config), None)
    drawn = draw_conditions(preset, config.seed, rows)
    sown = alter_world(world, rows, preset, drawn, config.seed)
    true_rows = [drawn.find_true_row(row) for row in rows]
    return RunWorld(_leave_out_crop(sown, true_rows, config), drawn)


def _leave_out_crop(world: WorldSpec, rows: Sequence[Row], config: RunConfig) -> WorldSpec:
    """Leave out the crop that the faults of the settings take from the beginning."""
    for fault in map(parse_fault, config.faults):
        if fault.name == "crop.gap":
            rng = make_stream(config.seed, f"fault {fault.name}")
            kept = leave_out_crop(world.plants, rows, fault.number, rng)
            world = msgspec.structs.replace(world, plants=tuple(kept))
    return world


def _alter_robot(robot: RobotSpec, drawn: Conditions) -> RobotSpec:
    radius_m = robot.drive.wheel_radius_m * (1.0 - drawn.wheel_wear_ratio)
    true = CalibrationConfig(wheel_radius_m=radius_m)
    if robot.camera is not None and (drawn.camera_height_m or any(drawn.camera_angles_deg)):
        pose = robot.body_from_link(robot.camera.link)
        angles_rad = [math.radians(angle_deg) for angle_deg in drawn.camera_angles_deg]
        turned = rotation_from_rpy(*angles_rad) @ robot.base_from_link(robot.camera.link)[:3, :3]
        true = msgspec.structs.replace(
            true,
            camera_height_m=float(pose[2, 3]) + drawn.camera_height_m,
            camera_rpy_rad=rpy_from_rotation(turned),
        )
    return apply_calibration(robot, true)
