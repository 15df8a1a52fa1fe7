"""One picture of the simulator's abilities: worlds, cameras, crops, light and labels."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np

from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.core.robot import CameraSpec
from agribot.core.world import HeightField, Light, WorldSpec
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import (
    CropSettings,
    FieldSettings,
    RowsSettings,
    SoilSettings,
    WeedsSettings,
)
from agribot.description.loader import load_robot
from agribot.description.terrain import sample_height
from agribot.description.worlds_sdf import load_world

if TYPE_CHECKING:
    from agribot.sim.camera import Rendering

WIDTH_PX, HEIGHT_PX, COLUMNS, GAP_PX, CAPTION_PX = 480, 330, 3, 8, 24
MORNING = Light(to_sun=(0.80, 0.35, 0.49), diffuse=1.25, ambient=0.55)
NOON = Light(to_sun=(0.30, -0.25, 0.92), diffuse=0.80, ambient=0.50)
EVENING = Light(to_sun=(-0.86, 0.36, 0.36), diffuse=1.55, ambient=0.58)
OVERCAST = Light(to_sun=(0.30, 0.20, 0.93), diffuse=0.12, ambient=0.88)
LABEL_RGB = {PlantClass.WEED: (226, 74, 51), PlantClass.CROP: (70, 168, 84)}
Show = Callable[["Rendering"], ByteArray]


class GalleryView(NamedTuple):
    """A camera over the ground: where it stands, how it looks, and how wide."""

    x_m: float
    y_m: float
    up_m: float
    down_deg: float
    yaw_deg: float
    hfov_deg: float = 62.0

    def pose(self, land: HeightField | None) -> FloatArray:
        """Compute `map_from_camera`, (4, 4)."""
        ground_m = 0.0 if land is None else sample_height(land, self.x_m, self.y_m)
        angles = (0.0, math.radians(self.down_deg), math.radians(self.yaw_deg))
        return transform((self.x_m, self.y_m, ground_m + self.up_m), angles) @ LINK_FROM_OPTICAL

    def camera(self) -> CameraSpec:
        return CameraSpec(
            link="camera_link", width_px=WIDTH_PX, height_px=HEIGHT_PX,
            hfov_rad=math.radians(self.hfov_deg), rate_hz=10.0, noise_std=0.004,
            clip_near_m=0.02, clip_far_m=400.0,
        )  # fmt: skip


class GalleryTile(NamedTuple):
    caption: str
    world: WorldSpec
    view: GalleryView
    show: str = "image"
    rover: tuple[float, float, float] | None = None  # x_m, y_m, yaw_rad: with the robot there


def draw_gallery() -> ByteArray:
    """Draw the picture, (height, width, 3)."""
    from PIL import Image, ImageDraw, ImageFont

    tiles = _list_tiles()
    rows = math.ceil(len(tiles) / COLUMNS)
    across, down = WIDTH_PX + GAP_PX, HEIGHT_PX + CAPTION_PX + GAP_PX
    sheet = Image.new("RGB", (COLUMNS * across + GAP_PX, rows * down + GAP_PX), (250, 250, 247))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for index, tile in enumerate(tiles):
        x_px = GAP_PX + index % COLUMNS * across
        y_px = GAP_PX + index // COLUMNS * down
        sheet.paste(Image.fromarray(_draw_tile(tile)), (x_px, y_px))
        draw.text((x_px + 2, y_px + HEIGHT_PX + 3), tile.caption, (60, 60, 55), font)
    return np.asarray(sheet)


def _draw_tile(tile: GalleryTile) -> ByteArray:
    from agribot.sim.camera import CameraRenderer

    robot = None if tile.rover is None else load_robot()
    body = None
    if tile.rover is not None:
        x_m, y_m, yaw_rad = tile.rover
        body = transform((x_m, y_m, 0.0), (0.0, 0.0, yaw_rad))
    seen = CameraRenderer(tile.world, robot).render(
        tile.view.pose(tile.world.terrain), tile.view.camera(), noise_seed=1, supersample=2,
        map_from_body=body, wheel_angles_rad=None if body is None else (0.3, 0.1, 0.4, 0.2),
    )  # fmt: skip
    return {"image": _draw_image, "labels": _draw_labels, "depth": _draw_depth}[tile.show](seen)


def _draw_image(seen: Rendering) -> ByteArray:
    return seen.image_rgb


def _draw_labels(seen: Rendering) -> ByteArray:
    """Draw classes over a grey picture, each plant in a shade of its own."""
    grey = seen.image_rgb.mean(axis=2, keepdims=True) * 0.9
    painted = np.repeat(grey, 3, axis=2)
    for kind, rgb in LABEL_RGB.items():
        there = (seen.class_id == kind) & (seen.instance >= 0)
        shade = 0.75 + 0.25 * ((seen.instance[there] * 37 % 11) / 10.0)
        painted[there] = np.array(rgb) * shade[:, None]
    shown: ByteArray = painted.astype(np.uint8)
    return shown


def _draw_depth(seen: Rendering) -> ByteArray:
    """Draw near light and warm, far dark and blue."""
    low_m, high_m = np.quantile(seen.depth_m, (0.01, 0.99))
    near = 1.0 - np.clip((seen.depth_m - low_m) / (high_m - low_m), 0.0, 1.0)[..., None]
    rgb = np.array([18.0, 30.0, 66.0]) * (1.0 - near) + np.array([255.0, 222.0, 150.0]) * near
    shown: ByteArray = rgb.astype(np.uint8)
    return shown


def _light_world(world: WorldSpec, light: Light) -> WorldSpec:
    return msgspec.structs.replace(world, light=light)


def _make_field(
    species: str, height_m: float, spacing_m: float, pitch_m: float, light: Light,
    *, weeds: tuple[str, ...] = ("grass", "goosefoot", "chickweed"), density_per_m2: float = 6.0,
    curvature_radpm: float = 0.0, **soil: float,
) -> WorldSpec:  # fmt: skip
    """Make rows to the North, the middle one starting at the origin."""
    count = 9
    plan = FieldSettings(
        name=species,
        spawn_xy_map_m=(0.0, -3.0),
        rows=RowsSettings(
            count=count, length_m=14.0, pitch_m=pitch_m, curvature_radpm=curvature_radpm,
            first_row_start_map_m=(-(count // 2) * pitch_m, 0.0),
        ),
        crop=CropSettings(
            species=species, spacing_m=spacing_m, height_m=height_m, height_spread_ratio=0.15,
            jitter_m=0.012, missing_ratio=0.03,
        ),
        weeds=WeedsSettings(
            species=weeds, density_per_m2=density_per_m2, height_min_m=0.03, height_max_m=0.09,
            crop_distance_m=0.06, cluster_ratio=0.5,
        ),
        soil=msgspec.convert(soil, SoilSettings),
    )  # fmt: skip
    return _light_world(generate_field(plan, 4), light)


def _list_tiles() -> list[GalleryTile]:
    beet = _make_field("sugar_beet", 0.14, 0.3, 0.78, MORNING, density_per_m2=9.0)
    nadir = GalleryView(0.0, 4.0, 1.05, 90.0, 90.0)
    rover = GalleryTile(
        "the robot at work, its shadow and its view's labels (right)", beet,
        GalleryView(-1.45, 2.2, 1.05, 25.0, 44.0), rover=(0.0, 3.6, math.pi / 2),
    )  # fmt: skip
    robot = load_robot()
    mast = transform((0.0, 3.6, 0.0), (0.0, 0.0, math.pi / 2)) @ robot.body_from_camera()
    eye = GalleryView(
        float(mast[0, 3]), float(mast[1, 3]), float(mast[2, 3]),
        math.degrees(math.asin(-mast[2, 2])), 90.0, 80.0,
    )  # fmt: skip
    return [
        GalleryTile("Farm world", _light_world(load_world("Farm"), NOON),
             GalleryView(3.5, -7.5, 4.2, 16.0, 90.0, 66.0)),
        GalleryTile("hills", _light_world(load_world("hills"), EVENING),
             GalleryView(3.5, -4.5, 3.4, 14.0, 90.0, 62.0)),
        GalleryTile("volcano", _light_world(load_world("volcano"), EVENING),
             GalleryView(0.0, -115.0, 62.0, 20.0, 90.0, 62.0)),
        rover,
        GalleryTile("sugar beet, the robot's own camera: class and instance", beet, eye, "labels"),
        GalleryTile("the same view: depth", beet, eye, "depth"),
        GalleryTile("maize in curved rows, evening sun",
             _make_field("maize", 0.45, 0.18, 0.75, EVENING, curvature_radpm=0.03),
             GalleryView(0.35, -1.2, 0.8, 12.0, 88.0, 66.0)),
        GalleryTile("lettuce, overcast, from straight above",
             _make_field("lettuce", 0.17, 0.28, 0.45, OVERCAST,
                         weeds=("thistle", "amaranth", "grass")),
             nadir),
        GalleryTile("carrots between straw residue, noon",
             _make_field("carrot", 0.13, 0.10, 0.5, NOON, residue_ratio=0.8),
             GalleryView(0.25, 0.6, 0.75, 36.0, 90.0)),
        GalleryTile("onions on wet, stony soil with wheel tracks",
             _make_field("onion", 0.28, 0.1, 0.5, MORNING, stones_ratio=0.7, wet_ratio=0.5,
                    track_gauge_m=0.25, weeds=("plantain", "charlock")),
             GalleryView(0.25, 0.4, 0.8, 34.0, 90.0)),
        GalleryTile("beet seedlings among chickweed and plantain",
             _make_field("sugar_beet", 0.07, 0.18, 0.45, NOON, weeds=("chickweed", "plantain"),
                    density_per_m2=18.0),
             GalleryView(0.0, 1.0, 0.5, 52.0, 90.0)),
        GalleryTile("charlock, thistle and goosefoot in beet, low sun",
             _make_field("sugar_beet", 0.13, 0.3, 0.6, EVENING, density_per_m2=14.0,
                    weeds=("charlock", "thistle", "goosefoot")),
             GalleryView(0.3, 1.2, 0.62, 30.0, 96.0)),
    ]  # fmt: skip
