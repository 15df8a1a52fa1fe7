"""Labelled views of random fields, for training and for tests.

What the network cannot know is left out of the labels.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from agribot.core.messages import ByteArray
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.losses import IGNORED
from agribot.lab.train.rough_ground import roughen
from agribot.sim.camera.renderer import CameraRenderer, Rendering
from agribot.sim.random_scenes import STANDARD, Variety, sample_field, sample_look, sample_view

VIEWS_PER_SCENE = 2
ROUGH_VIEWS_PER_SCENE = 3  # relief is dear to light
# Beyond it a pixel covers more than a weed; the robot does not look that far either.
LABEL_RANGE_M = 3.0


def draw_random_field(
    rng: np.random.Generator, views: int, variety: Variety = STANDARD
) -> Iterator[LabelledImage]:
    """Draw views of one random field from masts."""
    world = roughen(sample_field(rng, variety), (), variety, rng)
    renderer = CameraRenderer(world, appearance=sample_look(rng), threads=1)
    for _ in range(views):
        camera, map_from_camera = sample_view(rng)
        fine = 2 if rng.random() < 0.25 else 1
        drawn = renderer.render(
            map_from_camera, camera, noise_seed=int(rng.integers(2**31)), supersample=fine
        )
        yield drawn.image_rgb, make_label(drawn)


def make_label(drawn: Rendering) -> ByteArray:
    """Label pixels (H, W); those too far to tell are left out; sky counts as no plant."""
    far = (drawn.depth_m > LABEL_RANGE_M) & np.isfinite(drawn.depth_m)
    return np.where(far, np.uint8(IGNORED), drawn.class_id)
