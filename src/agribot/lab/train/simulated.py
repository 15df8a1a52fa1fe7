"""Labelled views of random fields, for training and for tests.

What the network cannot know is left out of the labels.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from agribot.core.messages import ByteArray
from agribot.lab.train.losses import IGNORED
from agribot.lab.train.plant_truth import LABEL_RANGE_M, DrawnView, find_plants
from agribot.lab.train.rough_ground import roughen
from agribot.sim.camera.renderer import CameraRenderer, Rendering
from agribot.sim.front_scenes import (
    FRONT_RANGE_M,
    sample_front_field,
    sample_front_look,
    sample_front_view,
)
from agribot.sim.ground_surface import build_ground_surface
from agribot.sim.random_scenes import (
    STANDARD,
    Variety,
    add_posts,
    draw_log_uniform,
    sample_field,
    sample_look,
    sample_view,
)
from agribot.sim.seedling_scenes import (
    FINER,
    sample_near_look,
    sample_overhead_view,
    sample_red_infrared_look,
    sample_seedlings,
    to_red_infrared,
)

VIEWS_PER_SCENE = 2
WIDTH_PX, HEIGHT_PX = 640, 480
INFRARED_SHARE, MOST_GROWTH = 0.5, 4.0
# Share of seedlings drawn in twice the pixels: as in photographs that were reduced.
SMOOTH_SHARE = 0.5
ROUGH_VIEWS_PER_SCENE = 3  # views of a rough scene: relief is dear to light
TAUGHT_VIEWS_PER_SCENE = 6  # views of such scenes, where many are needed


def draw_random_field(
    rng: np.random.Generator, views: int, variety: Variety = STANDARD
) -> Iterator[DrawnView]:
    """Draw views of one random field from masts."""
    world = roughen(sample_field(rng, variety), (), variety, rng)
    world = add_posts(world, variety, rng)
    ground = build_ground_surface(world)
    renderer = CameraRenderer(world, appearance=sample_look(rng), threads=1, ground=ground)
    for _ in range(views):
        camera, map_from_camera = sample_view(rng)
        fine = 2 if rng.random() < 0.25 else 1
        drawn = renderer.render(
            map_from_camera, camera, noise_seed=int(rng.integers(2**31)), supersample=fine
        )
        plants = find_plants(drawn, world, camera, map_from_camera, ground)
        yield DrawnView(drawn.image_rgb, make_label(drawn), plants)


def draw_seedlings(
    rng: np.random.Generator, views: int, variety: Variety = STANDARD
) -> Iterator[DrawnView]:
    """Draw views straight down on young carrots, half of the scenes in red and near infrared.

    Those are seedlings, as of `seedling_scenes`; in colours the plants are up to MOST_GROWTH times
    as tall. They are of no `variety`.
    """
    is_infrared = rng.random() < INFRARED_SHARE
    scale = 1.0 if is_infrared else draw_log_uniform(rng, 1.0, MOST_GROWTH)
    world = sample_seedlings(rng, scale)
    look = sample_red_infrared_look(rng) if is_infrared else sample_near_look(rng)
    renderer = CameraRenderer(world, appearance=look, threads=1, finer=FINER)
    for _ in range(views):
        camera, map_from_camera = sample_overhead_view(rng, scale)
        camera = msgspec.structs.replace(camera, width_px=WIDTH_PX, height_px=HEIGHT_PX)
        fine = 2 if rng.random() < SMOOTH_SHARE else 1
        drawn = renderer.render(
            map_from_camera, camera, noise_seed=int(rng.integers(2**31)), supersample=fine
        )
        image_rgb = to_red_infrared(drawn.image_rgb, rng) if is_infrared else drawn.image_rgb
        plants = find_plants(drawn, world, camera, map_from_camera)
        yield DrawnView(image_rgb, make_label(drawn), plants)


def draw_front(
    rng: np.random.Generator, views: int, variety: Variety = STANDARD
) -> Iterator[DrawnView]:
    """Draw views along rows to the horizon, as of `front_scenes`; they are of no `variety`."""
    world = sample_front_field(rng)
    renderer = CameraRenderer(world, appearance=sample_front_look(rng), threads=1)
    for _ in range(views):
        camera, map_from_camera = sample_front_view(rng)
        drawn = renderer.render(map_from_camera, camera, noise_seed=int(rng.integers(2**31)))
        plants = find_plants(drawn, world, camera, map_from_camera, range_m=FRONT_RANGE_M)
        yield DrawnView(drawn.image_rgb, make_label(drawn, FRONT_RANGE_M), plants)


def make_label(drawn: Rendering, range_m: float = LABEL_RANGE_M) -> ByteArray:
    """Label pixels (H, W); those too far away are left out; sky counts as no plant."""
    far = (drawn.depth_m > range_m) & np.isfinite(drawn.depth_m)
    return np.where(far, np.uint8(IGNORED), drawn.class_id)
