"""The world of a simulated run and the robot in it, as the seed draws them from a preset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from agribot.app.calibration.measured_robot import apply_calibration
from agribot.autonomy.estimate.sensors.gnss import MAX_FROM_DATUM_M
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import CalibrationConfig, RunConfig
from agribot.core.geo import Datum, MapFrame, rotation_from_rpy, rpy_from_rotation
from agribot.core.messages import PlantClass, Row
from agribot.core.platforms import find_platform
from agribot.core.robot import RobotSpec
from agribot.core.world import WorldSpec
from agribot.description.altered_world import alter_world
from agribot.description.conditions import Conditions, draw_conditions, load_condition_preset
from agribot.description.sdf_actors import load_figure
from agribot.description.sowing import leave_out_crop
from agribot.description.worlds_sdf import load_place, load_run_world


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
    world = _invite(load_run_world(config), config)
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


def _invite(world: WorldSpec, config: RunConfig) -> WorldSpec:
    """Add those who step into the robot's way."""
    from agribot.sim.visitors import add_visitors

    count = config.sim.visitors
    return add_visitors(world, count, config.seed, load_figure) if count else world


def settle_origin(config: RunConfig) -> RunConfig:
    """Put the map of a simulated run where its world is, if its datum is too far away to drive.

    A world whose file says no place is put at the datum. A chosen origin is left as it is.
    Raises: DescriptionError: no such world.
    """
    field = config.field
    if field.datum_source or not find_platform(config.platform).is_simulated:
        return config
    place = load_place(config.world)
    if place is None:
        source, place = f"the settings; world {config.world} states none", field.datum
    elif _measure_apart_m(field.datum, place) > MAX_FROM_DATUM_M:
        source = f"the place of world {config.world}, too far from that of the settings"
    else:
        return config
    field = msgspec.structs.replace(field, datum=place, datum_source=source)
    return msgspec.structs.replace(config, field=field)


def _measure_apart_m(one: Datum, other: Datum) -> float:
    return math.hypot(*MapFrame(one).map_from_geodetic(other.lat_deg, other.lon_deg, one.alt_m))


def _leave_out_crop(world: WorldSpec, rows: Sequence[Row], config: RunConfig) -> WorldSpec:
    """Leave out the crop that the faults of the settings take from the beginning."""
    from agribot.sim.faults.schedule import parse_fault
    from agribot.sim.random_streams import make_stream

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
