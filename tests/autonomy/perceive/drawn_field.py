"""A tilted camera on a robot and an exact way to draw plants into its class map."""

from __future__ import annotations

import math

import numpy as np

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.core.config import PerceptionConfig
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import PlantClass
from agribot.core.robot import CameraSpec

Disc = tuple[float, float, float, PlantClass]

MAP_SHAPE = (384, 512)
CONFIG = PerceptionConfig()
CAMERA = CameraSpec(
    link="camera_link",
    width_px=640,
    height_px=480,
    hfov_rad=math.radians(80.0),
    rate_hz=10.0,
    noise_std=0.0,
    clip_near_m=0.02,
    clip_far_m=300.0,
)
# 0.3 m ahead of the robot's centre, 0.7 m up, looking 50 degrees down.
BODY_FROM_CAMERA = transform((0.3, 0.0, 0.7), (0.0, math.radians(50.0), 0.0)) @ LINK_FROM_OPTICAL
GROUND = GroundLookup(CAMERA, BODY_FROM_CAMERA, MAP_SHAPE, CONFIG.max_range_m)


def draw(*discs: Disc, confidence: int = 240, height_ratio: float = 0.5) -> ClassMap:
    """Level discs (x_body_m, y_body_m, radius_m, class), later ones on top.

    They float over the ground at `height_ratio` of their diameter, as foliage does.
    """
    camera_m = GROUND.camera_xyz_body_m
    class_id = np.full(MAP_SHAPE, PlantClass.SOIL, dtype=np.uint8)
    for x_m, y_m, radius_m, plant in discs:
        nearer = 1.0 - height_ratio * 2.0 * radius_m / camera_m[2]
        at_x_m = camera_m[0] + (GROUND.x_body_m - camera_m[0]) * nearer
        at_y_m = camera_m[1] + (GROUND.y_body_m - camera_m[1]) * nearer
        class_id[np.hypot(at_x_m - x_m, at_y_m - y_m) <= radius_m] = plant
    return ClassMap(
        class_id=class_id,
        confidence=np.full(MAP_SHAPE, confidence, dtype=np.uint8),
        scale_px=(480 / MAP_SHAPE[0], 640 / MAP_SHAPE[1]),
    )
