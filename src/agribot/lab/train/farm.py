"""What the robot's own camera sees, with the robot in the picture: the Farm world and row crops.

The Farm world is a test set, never trained on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec
import numpy as np

from agribot.core.config import load
from agribot.core.geo import transform
from agribot.core.messages import WHEEL_NAMES, FloatArray, PlantClass
from agribot.core.world import Plant, Soil, WorldSpec
from agribot.description.field_generator import generate_field, lay_parallel_rows
from agribot.description.field_settings import (
    CropSettings,
    FieldSettings,
    RowsSettings,
    WeedsSettings,
)
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.lab.train.plant_truth import DrawnView, find_plants
from agribot.lab.train.rough_ground import roughen, stand_on
from agribot.lab.train.simulated import make_label
from agribot.sim.camera.appearance import Appearance
from agribot.sim.camera.renderer import CameraRenderer
from agribot.sim.ground_surface import build_ground_surface
from agribot.sim.random_scenes import (
    STANDARD,
    WEED_HEIGHT_M,
    Variety,
    add_posts,
    choose_crop,
    choose_weeds,
    draw_log_uniform,
    sample_light,
    sample_look,
    sample_soil,
)


def draw_farm(rng: np.random.Generator, views: int) -> Iterator[DrawnView]:
    """Draw views from a robot along the crop rows of one Farm world with its own weeds."""
    world = load_world("Farm", seed=int(rng.integers(2**31)))
    row_yaw_rad = math.radians(load("farm").field.row_yaw_deg)
    return _drive_rows(world, Appearance(), row_yaw_rad, rng, views)


def draw_row_crop(
    rng: np.random.Generator, views: int, variety: Variety = STANDARD
) -> Iterator[DrawnView]:
    """Draw views from a robot along the rows of a generated field of any growth and weediness."""
    world, look, row_yaw_rad = _choose_rows(rng, variety)
    return _drive_rows(world, look, row_yaw_rad, rng, views)


def draw_turn(
    rng: np.random.Generator, views: int, variety: Variety = STANDARD
) -> Iterator[DrawnView]:
    """Draw views from a robot that turns beside such rows, or comes to them from any side."""
    world, look, _ = _choose_rows(rng, variety)
    return _drive_rows(world, look, None, rng, views)


def _choose_rows(rng: np.random.Generator, variety: Variety) -> tuple[WorldSpec, Appearance, float]:
    """Choose a field, its look, and the direction of its rows."""
    plan = choose_plan(rng, variety)
    world = msgspec.structs.replace(
        generate_field(plan, int(rng.integers(2**31))),
        light=sample_light(rng),
        soil=sample_soil(rng) if variety.has_litter else Soil(),
    )
    world = roughen(world, lay_parallel_rows(plan.rows), variety, rng)
    world = add_posts(world, variety, rng)
    look = sample_look(rng) if rng.random() < 0.5 else Appearance()
    return world, look, math.radians(plan.rows.yaw_deg)


def choose_plan(rng: np.random.Generator, variety: Variety = STANDARD) -> FieldSettings:
    """Choose five rows, from dense seedlings to single tall plants, clean to full of weeds."""
    species, least_m, most_m = choose_crop(rng, variety)
    kinds = choose_weeds(rng, variety)
    low_m, high_m = np.sort(rng.uniform(*WEED_HEIGHT_M, 2))
    return FieldSettings(
        rows=RowsSettings(count=5, length_m=6.0, pitch_m=float(rng.uniform(0.45, 1.1))),
        crop=CropSettings(
            species=species,
            spacing_m=draw_log_uniform(rng, *(variety.spacing_m or (0.12, 2.0))),
            height_m=float(rng.uniform(least_m, most_m)),
            height_spread_ratio=float(rng.uniform(0.05, 0.3)),
            jitter_m=float(rng.uniform(0.0, 0.03)),
            missing_ratio=float(rng.uniform(0.0, 0.2)),
            gaps_per_row=0.3,
        ),
        weeds=WeedsSettings(
            density_per_m2=draw_log_uniform(rng, *(variety.weeds_per_m2 or (0.3, 12.0))),
            species=kinds,
            height_min_m=float(low_m),
            height_max_m=float(high_m),
            crop_distance_m=float(rng.uniform(0.02, 0.12)),
            cluster_ratio=float(rng.uniform(0.0, 0.8)),
        ),
    )


def _drive_rows(
    world: WorldSpec,
    look: Appearance,
    row_yaw_rad: float | None,
    rng: np.random.Generator,
    views: int,
) -> Iterator[DrawnView]:
    """Draw views along rows of this direction, or of any."""
    robot = load_robot()
    body_from_camera, camera = robot.body_from_camera(), robot.camera
    assert camera is not None  # body_from_camera() has looked
    ground = build_ground_surface(world)
    renderer = CameraRenderer(world, robot, appearance=look, threads=1, ground=ground)
    for _ in range(views):
        map_from_body = (
            choose_turn_pose(rng, world)
            if row_yaw_rad is None
            else choose_row_pose(rng, world, row_yaw_rad)
        )
        if ground.has_detail:
            map_from_body = stand_on(ground, map_from_body, robot.drive)
        map_from_camera = map_from_body @ body_from_camera
        drawn = renderer.render(
            map_from_camera,
            camera,
            noise_seed=int(rng.integers(2**31)),
            map_from_body=map_from_body,
            wheel_angles_rad=rng.uniform(0.0, math.tau, len(WHEEL_NAMES)).tolist(),
        )
        plants = find_plants(drawn, world, camera, map_from_camera, ground)
        yield DrawnView(drawn.image_rgb, make_label(drawn), plants)


def choose_row_pose(
    rng: np.random.Generator, world: WorldSpec, row_yaw_rad: float = math.pi / 2.0
) -> FloatArray:
    """Choose `map_from_body` (4, 4) on a crop row, up to 2 m before a plant, a little off."""
    plant = _choose_crop(rng, world)
    yaw_rad = row_yaw_rad + rng.choice([0.0, math.pi]) + rng.normal(0.0, 0.06)
    before_m, aside_m = rng.uniform(0.2, 2.0), rng.normal(0.0, 0.06)
    x_m = plant.x_map_m - before_m * math.cos(yaw_rad) - aside_m * math.sin(yaw_rad)
    y_m = plant.y_map_m - before_m * math.sin(yaw_rad) + aside_m * math.cos(yaw_rad)
    return transform((x_m, y_m, 0.0), (0.0, 0.0, yaw_rad))


def choose_turn_pose(rng: np.random.Generator, world: WorldSpec) -> FloatArray:
    """Choose `map_from_body` (4, 4) with a plant within 2.5 m, ahead or to the side."""
    plant, yaw_rad = _choose_crop(rng, world), rng.uniform(-math.pi, math.pi)
    away_m, bearing_rad = rng.uniform(0.5, 2.5), yaw_rad + rng.normal(0.0, 0.5)
    x_m = plant.x_map_m - away_m * math.cos(bearing_rad)
    y_m = plant.y_map_m - away_m * math.sin(bearing_rad)
    return transform((x_m, y_m, 0.0), (0.0, 0.0, yaw_rad))


def _choose_crop(rng: np.random.Generator, world: WorldSpec) -> Plant:
    crops = [plant for plant in world.plants if plant.plant == PlantClass.CROP]
    return crops[int(rng.integers(len(crops)))]
