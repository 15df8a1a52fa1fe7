"""Small worlds and views for the tests of the camera."""

from __future__ import annotations

import math

import numpy as np

from agribot.core.geo import LINK_FROM_OPTICAL, Datum, transform
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import CameraSpec, Origin, Shape
from agribot.core.world import GroundTile, HeightField, Light, Obstacle, Plant, WorldSpec
from agribot.sim.camera.renderer import Rendering

DATUM = Datum(lat_deg=21.0, lon_deg=73.0)
CAMERA = CameraSpec(
    link="camera_link", width_px=320, height_px=240, hfov_rad=1.3962634, rate_hz=30.0,
    noise_std=0.007, clip_near_m=0.02, clip_far_m=100.0,
)  # fmt: skip


def plant(
    x_map_m: float, y_map_m: float, species: str = "sugar_beet", *, size_m: float = 0.2,
    seed: int = 1, kind: PlantClass = PlantClass.CROP,
) -> Plant:  # fmt: skip
    return Plant(
        species=species, plant=kind, x_map_m=x_map_m, y_map_m=y_map_m, yaw_rad=0.3 * seed,
        size_m=size_m, seed=seed,
    )  # fmt: skip


def world(
    *plants: Plant,
    obstacles: tuple[Obstacle, ...] = (),
    ground: tuple[GroundTile, ...] = (),
    terrain: HeightField | None = None,
    light: Light | None = None,
) -> WorldSpec:
    return WorldSpec(
        name="test", datum=DATUM, plants=plants, obstacles=obstacles, ground=ground,
        terrain=terrain, light=light or Light(),
    )  # fmt: skip


def mixed_field(rng: np.random.Generator, count: int) -> WorldSpec:
    """Crops and weeds at random around (2, 0)."""
    plants = []
    for index in range(count):
        is_crop = rng.random() < 0.5
        species = "sugar_beet" if is_crop else str(rng.choice(["grass", "thistle", "goosefoot"]))
        x_m, y_m = rng.uniform((0.4, -1.5), (5.0, 1.5))
        kind = PlantClass.CROP if is_crop else PlantClass.WEED
        size_m = float(rng.uniform(0.1, 0.2))
        plants.append(plant(x_m, y_m, species, size_m=size_m, seed=index, kind=kind))
    return world(*plants)


def pose(
    x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.9, *, down_deg: float = 50.0,
    yaw_rad: float = 0.0,
) -> FloatArray:  # fmt: skip
    """`map_from_camera` of a camera that looks along its yaw and down."""
    return transform((x_m, y_m, z_m), (0.0, math.radians(down_deg), yaw_rad)) @ LINK_FROM_OPTICAL


def obstacle(kind: str, size_m: tuple[float, float, float], x_m: float, y_m: float, z_m: float) -> (
    Obstacle
):  # fmt: skip
    shape = Shape(kind=kind, size_m=size_m, origin=Origin(), rgba=(0.8, 0.2, 0.2, 1.0))
    return Obstacle(
        name=kind, kind=kind, x_map_m=x_m, y_map_m=y_m, z_map_m=z_m, yaw_rad=0.0, shapes=(shape,)
    )


def pixel_of(p_map_m: FloatArray, map_from_camera: FloatArray, camera: CameraSpec) -> FloatArray:
    """Column and row of a point of the map, by the pinhole matrix."""
    p_camera_m = np.linalg.inv(map_from_camera) @ np.append(p_map_m, 1.0)
    image: FloatArray = camera.matrix() @ (p_camera_m[:3] / p_camera_m[2])
    return image[:2]


def rays(map_from_camera: FloatArray, camera: CameraSpec) -> FloatArray:
    """Direction in the map of each pixel for one metre along the optical axis, (h, w, 3)."""
    v, u = np.mgrid[0 : camera.height_px, 0 : camera.width_px]
    pixels = np.stack([u, v, np.ones_like(u)], axis=-1).astype(float)
    directions: FloatArray = pixels @ (map_from_camera[:3, :3] @ np.linalg.inv(camera.matrix())).T
    return directions


def brightness(picture: Rendering) -> FloatArray:
    mean: FloatArray = picture.image_rgb.astype(float).mean(axis=2)
    return mean
