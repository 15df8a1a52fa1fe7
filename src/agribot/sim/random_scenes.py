"""Random crop fields, looks and camera poses: everything that a real field varies.

Crop, growth, spacing, weeds, soil, light, camera pose and camera colours are drawn from the
generator that is passed, in a fixed order: the same generator state gives the same scene.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.core.geo import LINK_FROM_OPTICAL, Datum, transform
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import CameraSpec, Shape
from agribot.core.world import GroundTile, Light, Obstacle, Plant, Soil, WorldSpec
from agribot.sim.camera.appearance import Appearance

FIELD_HALF_M = 4.0
DATUM = Datum(lat_deg=0.0, lon_deg=0.0)

# Species and the range of heights, metres.
CROPS = (("sugar_beet", 0.07, 0.26), ("lettuce", 0.06, 0.20), ("maize", 0.12, 0.45))
CROP_SHARE = (0.5, 0.25, 0.25)
WEEDS = ("grass", "goosefoot", "thistle", "amaranth")
ALL_CROPS = (
    *CROPS,
    ("carrot", 0.05, 0.22),
    ("onion", 0.08, 0.32),
    ("parsley", 0.05, 0.22),
    ("fodder_beet", 0.07, 0.40),
)
ALL_CROP_SHARE = (0.2, 0.15, 0.15, 0.125, 0.125, 0.125, 0.125)
FIELD_WEEDS = (*WEEDS, "chickweed", "plantain", "charlock", "chamomile")
# All weeds; the packaged networks have learned the last five as seedlings alone, or not at all.
ALL_WEEDS = (*FIELD_WEEDS, "millet", "knotweed", "quickweed", "milk_thistle", "mayweed")
WEED_HEIGHT_M = (0.025, 0.17)
POST_DEPTH_M = 0.15  # depth of posts in the ground, also where it lies low
POST_WIDTH_M, FULL_WIDTH_FROM_M = (0.03, 0.2), 0.3  # lower ones are thinner
# Crops from the first true leaves on; a preset's growth makes them still smaller.
YOUNG_CROPS = (
    ("sugar_beet", 0.05, 0.26),
    ("lettuce", 0.05, 0.20),
    ("maize", 0.08, 0.45),
    ("carrot", 0.04, 0.22),
    ("onion", 0.06, 0.32),
)


class Variety(NamedTuple):
    """Plants that may grow on a random field, and its relief.

    `weed_share` is None where all are as likely. With `has_litter` the soil has residue, stones
    and wet patches. On `rough_share` of the fields a preset of conditions sets ground and light;
    on `post_share` of them posts stand among the plants.
    """

    crops: tuple[tuple[str, float, float], ...]
    crop_share: tuple[float, ...]
    weeds: tuple[str, ...]
    weed_share: tuple[float, ...] | None = None
    has_litter: bool = False
    rough_share: float = 0.0
    # Distance of neighbouring crops; None: with room between them.
    spacing_m: tuple[float, float] | None = None
    weeds_per_m2: tuple[float, float] | None = None  # None: up to 20
    post_share: float = 0.0


STANDARD = Variety(CROPS, CROP_SHARE, WEEDS)
WIDE = Variety(ALL_CROPS, ALL_CROP_SHARE, ALL_WEEDS, has_litter=True)
ROUGH = Variety(
    YOUNG_CROPS,
    crop_share=(0.35, 0.15, 0.15, 0.175, 0.175),
    weeds=FIELD_WEEDS,
    weed_share=(0.18, 0.18, 0.18, 0.18, 0.07, 0.07, 0.07, 0.07),
    rough_share=0.5,
)
# Dense fields, from the seedling that has just come up to rows that close, and weeds from none to a
# carpet.
DENSE = Variety(
    (
        ("sugar_beet", 0.03, 0.26),
        ("lettuce", 0.04, 0.20),
        ("maize", 0.05, 0.45),
        ("carrot", 0.03, 0.22),
        ("onion", 0.05, 0.32),
    ),
    crop_share=(0.4, 0.15, 0.15, 0.15, 0.15),
    weeds=FIELD_WEEDS,
    rough_share=0.6,
    spacing_m=(0.05, 1.5),
    weeds_per_m2=(0.5, 80.0),
    post_share=0.3,
)
VARIETIES = {"standard": STANDARD, "wide": WIDE, "rough": ROUGH, "dense": DENSE}


def sample_field(rng: np.random.Generator, variety: Variety = STANDARD) -> WorldSpec:
    """Sample rows along x of one crop at one stage, with weeds among them, on level ground."""
    return WorldSpec(
        name="random field",
        datum=DATUM,
        light=sample_light(rng),
        ground=_sample_ground(rng),
        plants=(
            *_sample_rows(rng, variety),
            *_sample_weeds(rng, variety),
        ),
        obstacles=_sample_obstacles(rng),
        soil=sample_soil(rng) if variety.has_litter else Soil(),
    )


def sample_look(rng: np.random.Generator) -> Appearance:
    warm = rng.uniform(0.93, 1.07)
    return Appearance(
        texture_seed=int(rng.integers(40)),
        soil_tint=_to_rgb(rng.uniform(0.6, 1.25) * rng.uniform(0.9, 1.1, 3)),
        soil_contrast=rng.uniform(0.6, 1.3),
        soil_scale=rng.uniform(0.6, 1.6),
        leaf_gain=_to_rgb(rng.uniform(0.9, 1.1) * rng.uniform(0.94, 1.06, 3)),
        hue_spread=rng.uniform(0.7, 1.4),
        white_balance=(warm, rng.uniform(0.95, 1.05), 1.0 / warm),
        exposure=rng.uniform(0.85, 1.2),
        gamma=rng.uniform(0.88, 1.14),
        haze_per_m=rng.uniform(0.0, 0.01),
    )


def sample_camera(
    rng: np.random.Generator, hfov_deg: tuple[float, float], most_noise_std: float
) -> CameraSpec:
    """Sample a lens within these angles of view, and noise up to a standard deviation."""
    return CameraSpec(
        link="camera_link",
        width_px=640,
        height_px=480,
        hfov_rad=math.radians(rng.uniform(*hfov_deg)),
        rate_hz=10.0,
        noise_std=rng.uniform(0.0, most_noise_std),
        clip_near_m=0.02,
        clip_far_m=100.0,
    )


def sample_view(rng: np.random.Generator) -> tuple[CameraSpec, FloatArray]:
    """Sample a camera and `map_from_camera`, (4, 4).

    Mostly it is on a mast in front, sometimes at any height and tilt.
    """
    if rng.random() < 0.7:
        height_m, tilt_rad = rng.uniform(0.6, 1.1), math.radians(rng.uniform(40.0, 75.0))
    else:
        height_m, tilt_rad = rng.uniform(0.35, 1.3), math.radians(rng.uniform(30.0, 90.0))
    camera = sample_camera(rng, (58.0, 90.0), 0.015)
    # Mostly along a row, either way; sometimes across, as on the headland.
    yaw_rad = rng.choice([0.0, math.pi]) + rng.normal(0.0, 0.15)
    if rng.random() < 0.3:
        yaw_rad = rng.uniform(-math.pi, math.pi)
    position_m = (rng.uniform(-2.0, 2.0), rng.uniform(-1.2, 1.2), height_m)
    link = transform(position_m, (rng.normal(0.0, 0.04), tilt_rad, yaw_rad))
    return camera, link @ LINK_FROM_OPTICAL


def sample_soil(rng: np.random.Generator) -> Soil:
    """Sample a soil; residue, stones and wet patches each occur on about every other field."""
    residue, stones, wet = np.maximum(0.0, rng.uniform(-0.8, 1.0, 3)).tolist()
    return Soil(residue_ratio=residue, stones_ratio=stones, wet_ratio=0.7 * wet)


def _sample_rows(rng: np.random.Generator, variety: Variety) -> list[Plant]:
    species, least_m, most_m = choose_crop(rng, variety)
    stage_m = rng.uniform(least_m, most_m)
    pitch_m = rng.uniform(0.4, 1.0)
    if variety.spacing_m is None:
        spacing_m = draw_log_uniform(rng, 0.15, 2.0) + stage_m
    else:
        spacing_m = draw_log_uniform(rng, *variety.spacing_m)
    gaps, jitter_m = rng.uniform(0.0, 0.3), rng.uniform(0.005, 0.04)
    plants = []
    for y_m in np.arange(-2.5 + rng.uniform(0.0, pitch_m), 2.5, pitch_m):
        for x_m in np.arange(-FIELD_HALF_M + rng.uniform(0.0, spacing_m), FIELD_HALF_M, spacing_m):
            if rng.random() >= gaps:
                place_m = rng.normal((x_m, y_m), jitter_m)
                size_m = float(np.clip(stage_m * rng.normal(1.0, 0.15), least_m, most_m))
                plants.append(place_plant(rng, species, PlantClass.CROP, place_m, size_m))
    return plants


def draw_log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform between those of the limits."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def choose_crop(rng: np.random.Generator, variety: Variety) -> tuple[str, float, float]:
    """Choose a species and return it with its range of heights, metres."""
    return variety.crops[rng.choice(len(variety.crops), p=variety.crop_share)]


def choose_weeds(rng: np.random.Generator, variety: Variety) -> tuple[str, ...]:
    """Choose one to four species."""
    count = int(rng.integers(1, 5))
    kinds = rng.choice(variety.weeds, size=count, replace=False, p=variety.weed_share)
    return tuple(str(kind) for kind in kinds)


def _sample_weeds(rng: np.random.Generator, variety: Variety) -> list[Plant]:
    """Sample single weeds and patches of them, of one to four species."""
    density_per_m2 = draw_log_uniform(rng, *(variety.weeds_per_m2 or (1.0, 20.0)))
    kinds = choose_weeds(rng, variety)
    count = int(density_per_m2 * 2.0 * FIELD_HALF_M * 5.0)
    patches_m = rng.uniform((-FIELD_HALF_M, -2.5), (FIELD_HALF_M, 2.5), (max(1, count // 25), 2))
    median_m = rng.uniform(0.04, 0.10)
    plants = []
    for _ in range(count):
        place_m = rng.uniform((-FIELD_HALF_M, -2.5), (FIELD_HALF_M, 2.5))
        if rng.random() < 0.4:
            place_m = rng.normal(patches_m[rng.integers(len(patches_m))], 0.3)
        size_m = float(np.clip(median_m * rng.lognormal(0.0, 0.45), *WEED_HEIGHT_M))
        plants.append(place_plant(rng, str(rng.choice(kinds)), PlantClass.WEED, place_m, size_m))
    return plants


def place_plant(
    rng: np.random.Generator, species: str, plant: PlantClass, place_m: FloatArray, size_m: float
) -> Plant:
    return Plant(
        species=species,
        plant=plant,
        x_map_m=float(place_m[0]),
        y_map_m=float(place_m[1]),
        yaw_rad=float(rng.uniform(-math.pi, math.pi)),
        size_m=size_m,
        seed=int(rng.integers(2**31)),
    )


def sample_light(rng: np.random.Generator) -> Light:
    height_rad, turn_rad = math.radians(rng.uniform(18.0, 80.0)), rng.uniform(-math.pi, math.pi)
    overcast = rng.random() < 0.3
    return Light(
        to_sun=(
            math.cos(height_rad) * math.cos(turn_rad),
            math.cos(height_rad) * math.sin(turn_rad),
            math.sin(height_rad),
        ),
        diffuse=rng.uniform(0.05, 0.25) if overcast else rng.uniform(0.55, 0.95),
        ambient=rng.uniform(0.7, 1.0) if overcast else rng.uniform(0.35, 0.6),
    )


def _sample_ground(rng: np.random.Generator) -> tuple[GroundTile, ...]:
    """Sample the ground: soil, and sometimes grass, pavement or gravel beside it."""
    tiles = [make_ground_tile("soil", -60.0, 60.0)]
    if rng.random() < 0.4:
        edge_m = rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 2.0)
        surface = str(rng.choice(["grass", "pavement", "gravel"], p=[0.6, 0.2, 0.2]))
        tiles.append(
            make_ground_tile(surface, *((edge_m, 60.0) if edge_m > 0 else (-60.0, edge_m)))
        )
    return tuple(tiles)


def make_ground_tile(surface: str, y_min_m: float, y_max_m: float) -> GroundTile:
    return GroundTile(
        surface=surface, x_min_m=-60.0, x_max_m=60.0, y_min_m=float(y_min_m), y_max_m=float(y_max_m)
    )


def _sample_obstacles(rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """Sample posts, boxes and balls of any colour; green ones too, which are no plants."""
    obstacles = []
    for index in range(int(rng.integers(0, 4)) if rng.random() < 0.4 else 0):
        kind = str(rng.choice(["cylinder", "box", "sphere"]))
        size_m = tuple(float(s) for s in rng.uniform(0.03, 0.3, 3))
        shape = Shape(kind=kind, size_m=(size_m[0], size_m[1], size_m[2]), rgba=_sample_rgba(rng))
        x_m, y_m = rng.uniform((-3.0, -2.0), (3.0, 2.0))
        obstacles.append(
            Obstacle(
                name=f"thing {index}",
                kind=kind,
                x_map_m=float(x_m),
                y_map_m=float(y_m),
                z_map_m=float(rng.uniform(0.0, 0.3)),
                yaw_rad=float(rng.uniform(-math.pi, math.pi)),
                shapes=(shape,),
            )
        )
    return tuple(obstacles)


def add_posts(world: WorldSpec, variety: Variety, rng: np.random.Generator) -> WorldSpec:
    """Let one to four posts stand near crops of a share of the worlds."""
    if not variety.post_share or rng.random() >= variety.post_share:
        return world
    crops = [plant for plant in world.plants if plant.plant == PlantClass.CROP]
    posts = []
    for index in range(int(rng.integers(1, 5)) if crops else 0):
        near = crops[int(rng.integers(len(crops)))]
        place_m = rng.normal((near.x_map_m, near.y_map_m), 0.4)
        posts.append(make_post(rng, index, place_m, float(rng.uniform(0.15, 1.2))))
    return msgspec.structs.replace(world, obstacles=(*world.obstacles, *posts))


def make_post(
    rng: np.random.Generator, index: int, place_m: FloatArray, height_m: float
) -> Obstacle:
    """Make a pole, a stake or a label, white, grey, of wood or of any colour."""
    kind = str(rng.choice(["cylinder", "box"]))
    length_m = height_m + POST_DEPTH_M
    width_m = draw_log_uniform(rng, *POST_WIDTH_M) * min(1.0, height_m / FULL_WIDTH_FROM_M)
    if kind == "cylinder":
        size_m = (width_m / 2.0, length_m, 0.0)
    else:
        size_m = (width_m, width_m * float(rng.uniform(0.1, 1.0)), length_m)
    return Obstacle(
        name=f"post {index}",
        kind=kind,
        x_map_m=float(place_m[0]),
        y_map_m=float(place_m[1]),
        z_map_m=length_m / 2.0 - POST_DEPTH_M,
        yaw_rad=float(rng.uniform(-math.pi, math.pi)),
        shapes=(Shape(kind=kind, size_m=size_m, rgba=_sample_post_rgba(rng)),),
    )


def _sample_post_rgba(rng: np.random.Generator) -> tuple[float, float, float, float]:
    material, light = rng.random(), rng.uniform(0.4, 1.0)
    if material < 0.5:  # plastic, zinc, concrete
        return light, light, light * rng.uniform(0.9, 1.0), 1.0
    if material < 0.75:  # wood
        return light, light * rng.uniform(0.7, 0.85), light * rng.uniform(0.4, 0.65), 1.0
    return _sample_rgba(rng)


def _sample_rgba(rng: np.random.Generator) -> tuple[float, float, float, float]:
    red, green, blue = rng.uniform(0.05, 0.95, 3)
    return float(red), float(green), float(blue), 1.0


def _to_rgb(values: FloatArray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
