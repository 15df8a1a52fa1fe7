"""Row crops as the front camera of a robot sees them, from under its wheels to the horizon.

Fields are stony or bare, soil is grey to brown, leaves are dull or glossy, the sun often stands low
before, behind or beside the camera. Some crops are species that grow as weeds elsewhere, and some
weeds are crops of another year, also of the crop's own species: what stands in the rows is the
crop, and what stands between them is a weed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.robot import CameraSpec
from agribot.core.world import GroundTile, Light, Plant, Soil, WorldSpec
from agribot.sim.camera.appearance import Appearance
from agribot.sim.random_scenes import (
    DATUM,
    FIELD_WEEDS,
    draw_log_uniform,
    make_ground_tile,
    place_plant,
    sample_camera,
    sample_light,
    sample_look,
    sample_soil,
)

# The field: from behind the camera to its end, and as far to both sides; metres.
BEHIND_M, AHEAD_M, ASIDE_M = 0.5, 12.0, 4.0
FRONT_RANGE_M = 9.0  # distance beyond which plants are too small to distinguish
# Species, range of heights in metres, and share of the fields.
FRONT_CROPS = (
    ("sugar_beet", 0.05, 0.30, 0.26),
    ("fodder_beet", 0.06, 0.42, 0.30),
    ("lettuce", 0.05, 0.22, 0.10),
    ("maize", 0.08, 0.45, 0.07),
    ("carrot", 0.05, 0.24, 0.06),
    ("onion", 0.06, 0.32, 0.06),
    ("amaranth", 0.05, 0.25, 0.04),
    ("plantain", 0.04, 0.16, 0.03),
    ("charlock", 0.05, 0.25, 0.04),
    ("goosefoot", 0.05, 0.25, 0.04),
)
# Shares of the crop's height: the median of the weeds, and the largest. A crop outgrows its weeds.
WEED_SIZE_RATIO, LARGEST_RATIO = (0.2, 0.7), 0.85
LEAST_WEED_M = 0.025
WEEDS_PER_M2 = (0.8, 20.0)
# Probability of the crop's own species among the weeds, and the least distance of such a plant from
# a row, as a share of the way from row to row.
VOLUNTEER_SHARE, LEAST_OFF_ROW_RATIO = 0.5, 0.28
VOLUNTEERS = ("sugar_beet", "fodder_beet", "lettuce", "carrot")
STONY_SHARE, LOW_SUN_SHARE, HEADLAND_SHARE = 0.65, 0.5, 0.5


class _Rows(NamedTuple):
    """Rows along x: their places across, and how far apart they are, metres."""

    y_m: FloatArray
    pitch_m: float

    def find_off_row_ratio(self, y_m: float) -> float:
        """Find the way to the nearest row over that from row to row: 0 on a row, 0.5 between."""
        return float(np.abs(self.y_m - y_m).min()) / self.pitch_m


def sample_front_field(rng: np.random.Generator) -> WorldSpec:
    """Sample rows along x of one crop at one stage, with weeds between and in them."""
    species, least_m, most_m = _choose_crop(rng)
    stage_m = draw_log_uniform(rng, least_m, most_m)
    pitch_m = float(rng.uniform(0.42, 0.65)) + 0.5 * max(0.0, stage_m - 0.2)
    rows = _Rows(np.arange(-ASIDE_M + rng.uniform(0.0, pitch_m), ASIDE_M, pitch_m), pitch_m)
    crops = _sample_crops(rng, rows, species, stage_m)
    return WorldSpec(
        name="front field",
        datum=DATUM,
        light=_sample_light(rng),
        ground=_sample_ground(rng),
        plants=(*crops, *_sample_weeds(rng, rows, species, stage_m)),
        obstacles=(),
        soil=sample_soil(rng) if rng.random() < 0.5 else Soil(),
    )


def _choose_crop(rng: np.random.Generator) -> tuple[str, float, float]:
    shares = [share for *_, share in FRONT_CROPS]
    species, least_m, most_m, _ = FRONT_CROPS[rng.choice(len(FRONT_CROPS), p=shares)]
    return species, least_m, most_m


def _sample_crops(
    rng: np.random.Generator, rows: _Rows, species: str, stage_m: float
) -> list[Plant]:
    spacing_m = draw_log_uniform(rng, 0.1, 0.45) + 0.5 * stage_m
    gap_ratio, jitter_m = rng.uniform(0.0, 0.5), rng.uniform(0.005, 0.03)
    spread_ratio = rng.uniform(0.1, 0.3)
    plants = []
    for y_m in rows.y_m:
        for x_m in np.arange(-BEHIND_M + rng.uniform(0.0, spacing_m), AHEAD_M, spacing_m):
            if rng.random() >= gap_ratio:
                place_m = rng.normal((x_m, y_m), (2.0 * jitter_m, jitter_m))
                size_m = stage_m * float(np.clip(rng.normal(1.0, spread_ratio), 0.4, 1.6))
                plants.append(place_plant(rng, species, PlantClass.CROP, place_m, size_m))
    return plants


def _choose_weeds(rng: np.random.Generator, crop: str) -> list[str]:
    """Choose one to four species, and often the crop's own as well."""
    others = [name for name in (*FIELD_WEEDS, *VOLUNTEERS) if name != crop]
    kinds = [str(kind) for kind in rng.choice(others, int(rng.integers(1, 5)), replace=False)]
    return [*kinds, crop] if rng.random() < VOLUNTEER_SHARE else kinds


def _sample_weeds(rng: np.random.Generator, rows: _Rows, crop: str, stage_m: float) -> list[Plant]:
    """Sample weeds singly and in patches; those of the crop's species stand between the rows."""
    kinds = _choose_weeds(rng, crop)
    count = int(draw_log_uniform(rng, *WEEDS_PER_M2) * (AHEAD_M + BEHIND_M) * 2.0 * ASIDE_M)
    low_m, high_m = (-BEHIND_M, -ASIDE_M), (AHEAD_M, ASIDE_M)
    patches_m = rng.uniform(low_m, high_m, (max(1, count // 30), 2))
    median_m = stage_m * rng.uniform(*WEED_SIZE_RATIO)
    plants = []
    for _ in range(count):
        place_m = rng.uniform(low_m, high_m)
        if rng.random() < 0.4:
            place_m = rng.normal(patches_m[rng.integers(len(patches_m))], 0.35)
        grown_m = min(median_m * rng.lognormal(0.0, 0.5), LARGEST_RATIO * stage_m)
        size_m = float(max(grown_m, LEAST_WEED_M))
        kind = kinds[int(rng.integers(len(kinds)))]
        if kind != crop or rows.find_off_row_ratio(place_m[1]) > LEAST_OFF_ROW_RATIO:
            plants.append(place_plant(rng, kind, PlantClass.WEED, place_m, size_m))
    return plants


def _sample_light(rng: np.random.Generator) -> Light:
    """Sample the light of other fields, or a low and hard sun."""
    if rng.random() >= LOW_SUN_SHARE:
        return sample_light(rng)
    height_rad, turn_rad = math.radians(rng.uniform(10.0, 45.0)), rng.uniform(-math.pi, math.pi)
    level = math.cos(height_rad)
    to_sun = (level * math.cos(turn_rad), level * math.sin(turn_rad), math.sin(height_rad))
    return Light(to_sun=to_sun, diffuse=rng.uniform(0.8, 1.4), ambient=rng.uniform(0.2, 0.45))


def _sample_ground(rng: np.random.Generator) -> tuple[GroundTile, ...]:
    """Sample the field, and sometimes a green headland behind its end."""
    field = make_ground_tile("soil", -60.0, 60.0)
    if rng.random() >= HEADLAND_SHARE:
        return (field,)
    end_m = AHEAD_M + rng.uniform(0.0, 4.0)
    headland = msgspec.structs.replace(field, surface="grass", x_min_m=end_m, x_max_m=90.0)
    return field, headland


def sample_front_look(rng: np.random.Generator) -> Appearance:
    """Sample a look with grey to brown soil, bare or under stones, and leaves dull to vivid."""
    grey, soil = rng.uniform(0.0, 1.1), rng.uniform(0.6, 1.35)
    dull, leaf = rng.uniform(0.0, 1.0), rng.uniform(0.75, 1.2)
    is_stony = rng.random() < STONY_SHARE
    return msgspec.structs.replace(
        sample_look(rng),
        soil_tint=(soil * (1.0 - 0.1 * grey), soil * (1.0 + 0.08 * grey), soil * (1 + 0.35 * grey)),
        soil_contrast=rng.uniform(0.8, 1.3 if is_stony else 2.2),
        soil_scale=rng.uniform(0.5, 1.6),
        leaf_gain=(leaf * (1.0 + 0.22 * dull), leaf, leaf * (1.0 + 0.6 * dull)),
        flint_cover_ratio=rng.uniform(0.05, 0.55) if is_stony else 0.0,
        auto_exposure_level=rng.uniform(60.0, 150.0),
        haze_per_m=draw_log_uniform(rng, 0.001, 0.03),
    )


def sample_front_view(rng: np.random.Generator) -> tuple[CameraSpec, FloatArray]:
    """Sample a camera and `map_from_camera`, (4, 4), that looks along the rows."""
    if rng.random() < 0.75:
        height_m, tilt_rad = rng.uniform(0.6, 1.2), math.radians(rng.uniform(16.0, 40.0))
    else:
        height_m, tilt_rad = rng.uniform(0.4, 1.5), math.radians(rng.uniform(14.0, 85.0))
    camera = sample_camera(rng, (48.0, 85.0), 0.02)
    position_m = (rng.uniform(0.0, 1.0), rng.uniform(-0.5, 0.5), height_m)
    link = transform(position_m, (rng.normal(0.0, 0.05), tilt_rad, rng.normal(0.0, 0.25)))
    return camera, link @ LINK_FROM_OPTICAL
