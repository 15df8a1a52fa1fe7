"""Seedlings close from above, as a camera for red and near infrared sees them.

Young carrots, or parsley with its broader leaflets, stand in a row. Of the weeds among them
chamomile and mayweed look most like their leaves, and knotweed like their seed leaves. The camera
looks straight down on a stretch of about two hand-widths. Its picture shows red as red and blue,
and near infrared as green, as that of the Crop/Weed Field Image Dataset does: soil is grey there,
and leaves are green, because they reflect far more of the infrared than of the red.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.core.robot import CameraSpec
from agribot.core.world import Light, Obstacle, Plant, Soil, WorldSpec
from agribot.sim.camera.appearance import Appearance
from agribot.sim.random_scenes import (
    ALL_WEEDS,
    DATUM,
    draw_log_uniform,
    make_ground_tile,
    make_post,
    place_plant,
    sample_light,
    sample_look,
    sample_soil,
)

HALF_M = 0.3
LOOKALIKES = ("chamomile", "mayweed", "knotweed")
OTHER_WEEDS = tuple(name for name in ALL_WEEDS if name not in LOOKALIKES)
GRASSES = ("millet", "grass")
CROP_HEIGHT_M = (0.005, 0.032)
WEED_HEIGHT_M = (0.003, 0.045)
MEDIAN_WEED_M = (0.005, 0.026)
LABEL_SHARE = 0.15
FINER = 3.0  # meshes than those of plants that a robot's camera sees


def sample_seedlings(rng: np.random.Generator, scale: float = 1.0) -> WorldSpec:
    """Sample a stretch of a row of carrots or parsley along x through the origin, with weeds.

    Plants are `scale` times as tall as seedlings, and stand as much farther apart.
    """
    light = sample_light(rng)
    if rng.random() < 0.7:  # shaded, as such cameras often are
        light = Light(
            to_sun=light.to_sun, diffuse=rng.uniform(0.1, 0.35), ambient=rng.uniform(0.65, 0.95)
        )
    return WorldSpec(
        name="seedlings",
        datum=DATUM,
        light=light,
        ground=(make_ground_tile("soil", -60.0, 60.0),),
        plants=(*_sample_row(rng, scale), *_sample_weeds(rng, scale)),
        obstacles=_sample_labels(rng, scale),
        soil=sample_soil(rng) if rng.random() < 0.15 else Soil(),
    )


def sample_red_infrared_look(rng: np.random.Generator) -> Appearance:
    """Sample a look with red as red and near infrared as green.

    The red of brown soil and green leaves is dimmed. From so near, soil is rough: its clods are
    small in the texture and stand out.
    """
    soil = rng.uniform(0.6, 1.4)
    leaf_red, leaf_infrared = 0.62 * rng.uniform(0.85, 1.2), 1.15 * rng.uniform(0.85, 1.15)
    return msgspec.structs.replace(
        sample_look(rng),
        soil_tint=(0.66 * soil, 0.85 * soil * rng.uniform(0.95, 1.1), 0.85 * soil),
        soil_contrast=rng.uniform(1.0, 2.6),
        soil_scale=draw_log_uniform(rng, 0.1, 0.8),
        leaf_gain=(leaf_red, leaf_infrared, 1.0),
        white_balance=(1.0, 1.0, 1.0),
    )


def sample_near_look(rng: np.random.Generator) -> Appearance:
    """Sample a look in colours, with soil as rough as it is from so near."""
    return msgspec.structs.replace(
        sample_look(rng),
        soil_contrast=rng.uniform(1.0, 2.6),
        soil_scale=draw_log_uniform(rng, 0.1, 0.8),
    )


def to_red_infrared(image_rgb: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Convert a picture (H, W, 3) to the bands of such a camera, (H, W, 3): red, infrared, red.

    Light that is scattered fills the shadows more in the infrared than in the red, so that dark
    soil is greenish and bright soil violet: on the soil of that data set's pictures the infrared
    is about 0.7 times the red plus 24 grey levels, with grain of its own.
    """
    both = image_rgb.astype(np.float32)
    both[..., 1] = both[..., 1] * rng.uniform(0.65, 0.95) + rng.uniform(5.0, 28.0)
    height, width = both.shape[:2]
    for coarse in (2, 8, 32):
        grain = rng.normal(0.0, rng.uniform(0.0, 5.0), (height // coarse + 2, width // coarse + 2))
        spread = np.kron(grain, np.ones((coarse, coarse)))[:height, :width]
        both[..., 0] += spread
        both[..., 1] -= 0.5 * spread
    if rng.random() < 0.5:
        _scatter_grains(both, rng)
    both[..., 2] = both[..., 0]
    return np.clip(both.round(), 0, 255).astype(np.uint8)


def _scatter_grains(both: npt.NDArray[np.float32], rng: np.random.Generator) -> None:
    """Scatter heaps of bright grains, as of fertiliser, over the soil of a picture (H, W, 3)."""
    height, width = both.shape[:2]
    for _ in range(int(rng.integers(1, 12))):
        spread_px = rng.uniform(4.0, 30.0)
        middle = rng.uniform(0.0, (height, width))
        at = rng.normal(middle, spread_px, (int(rng.integers(10, 90)), 2)).astype(int)
        for row, column in at:
            if not (0 <= row < height and 0 <= column < width):
                continue
            side = int(rng.integers(1, 4))
            grain = both[row : row + side, column : column + side]
            if (grain[..., 1] < grain[..., 0] + 30.0).all():
                grain[..., 0] += rng.uniform(40.0, 150.0)
                grain[..., 1] += rng.uniform(30.0, 110.0)


def sample_overhead_view(
    rng: np.random.Generator, scale: float = 1.0
) -> tuple[CameraSpec, FloatArray]:
    """Sample a camera that looks straight down, and `map_from_camera` (4, 4).

    It sees 0.12 to 0.32 m, times `scale`.
    """
    width_m, height_m = scale * rng.uniform(0.12, 0.32), scale * rng.uniform(0.4, 0.6)
    camera = CameraSpec(
        link="camera_link",
        width_px=648,
        height_px=484,
        hfov_rad=2.0 * math.atan(0.5 * width_m / height_m),
        rate_hz=10.0,
        noise_std=rng.uniform(0.0, 0.015),
        clip_near_m=0.02,
        clip_far_m=100.0,
    )
    aside_m = scale * rng.uniform((-0.1, -0.04), (0.1, 0.04))
    position_m = (float(aside_m[0]), float(aside_m[1]), height_m)
    tilt_rad = 0.5 * math.pi + rng.normal(0.0, 0.05)
    link = transform(position_m, (rng.normal(0.0, 0.03), tilt_rad, rng.uniform(-math.pi, math.pi)))
    return camera, link @ LINK_FROM_OPTICAL


def _sample_labels(rng: np.random.Generator, scale: float) -> tuple[Obstacle, ...]:
    """Sample labels and stakes that people put into the ground of such plots."""
    return tuple(
        make_post(rng, index, scale * rng.uniform(-0.15, 0.15, 2), scale * rng.uniform(0.02, 0.15))
        for index in range(int(rng.integers(1, 3)) if rng.random() < LABEL_SHARE else 0)
    )


def _sample_row(rng: np.random.Generator, scale: float) -> list[Plant]:
    height_m, spacing_m = draw_log_uniform(rng, *CROP_HEIGHT_M), rng.uniform(0.012, 0.06)
    crop = "parsley" if rng.random() < 0.35 else "carrot"
    plants = []
    for x_m in np.arange(-HALF_M, HALF_M, spacing_m):
        if rng.random() < 0.8:
            place_m = scale * rng.normal((x_m, 0.0), 0.012)
            size_m = scale * height_m * rng.lognormal(0.0, 0.25)
            plants.append(place_plant(rng, crop, PlantClass.CROP, place_m, size_m))
    return plants


def _sample_weeds(rng: np.random.Generator, scale: float) -> list[Plant]:
    kinds = rng.choice(OTHER_WEEDS, size=int(rng.integers(1, 5)), replace=False).tolist()
    if rng.random() < 0.5:
        kinds.append(str(rng.choice(GRASSES)))
    kinds += [name for name in LOOKALIKES if rng.random() < 0.45]
    density_per_m2 = draw_log_uniform(rng, 40.0, 500.0)
    median_m = draw_log_uniform(rng, *MEDIAN_WEED_M)
    plants = []
    for _ in range(int(rng.poisson(density_per_m2 * (2.0 * HALF_M) ** 2))):
        place_m = scale * rng.uniform(-HALF_M, HALF_M, 2)
        size_m = scale * float(np.clip(median_m * rng.lognormal(0.0, 0.5), *WEED_HEIGHT_M))
        species = kinds[rng.integers(len(kinds))]
        plants.append(place_plant(rng, species, PlantClass.WEED, place_m, size_m))
    return plants
