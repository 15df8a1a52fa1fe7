"""What the robot's own camera sees on the Farm world: a test set, never trained on."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from agribot.config import load
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_world
from agribot.geo import transform
from agribot.messages import FloatArray, PlantClass
from agribot.sim.camera.renderer import CameraRenderer
from agribot.train.data import LabelledImage
from agribot.train.simulated import label_of
from agribot.world import WorldSpec


def draw_farm(rng: np.random.Generator, views: int) -> Iterator[LabelledImage]:
    """Views from a robot that drives along the crop rows of one Farm world with its own weeds."""
    world = load_world("Farm", seed=int(rng.integers(2**31)))
    robot = load_robot()
    body_from_camera, camera = robot.body_from_camera(), robot.camera
    assert camera is not None  # body_from_camera() has looked
    renderer = CameraRenderer(world, threads=1)
    for _ in range(views):
        drawn = renderer.render(
            row_pose(rng, world) @ body_from_camera, camera, noise_seed=int(rng.integers(2**31))
        )
        yield drawn.image_rgb, label_of(drawn)


def row_pose(rng: np.random.Generator, world: WorldSpec) -> FloatArray:
    """`map_from_body` on a crop row, up to 2 m before a plant, a little off the row."""
    crops = [plant for plant in world.plants if plant.plant == PlantClass.CROP]
    plant = crops[int(rng.integers(len(crops)))]
    row_yaw_rad = math.radians(load("farm").field.row_yaw_deg)
    yaw_rad = row_yaw_rad + rng.choice([0.0, math.pi]) + rng.normal(0.0, 0.06)
    before_m, aside_m = rng.uniform(0.2, 2.0), rng.normal(0.0, 0.06)
    x_m = plant.x_map_m - before_m * math.cos(yaw_rad) - aside_m * math.sin(yaw_rad)
    y_m = plant.y_map_m - before_m * math.sin(yaw_rad) + aside_m * math.cos(yaw_rad)
    return transform((x_m, y_m, 0.0), (0.0, 0.0, yaw_rad))
