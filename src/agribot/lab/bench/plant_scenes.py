"""Fields on which single plants are judged: rows that close, other crops, and carpets of weeds."""

from __future__ import annotations

import zlib

import msgspec
import numpy as np

from agribot.core.messages import Row
from agribot.core.world import WorldSpec
from agribot.description.altered_world import alter_world
from agribot.description.conditions import draw_conditions, load_condition_preset
from agribot.description.field_generator import generate_field, lay_parallel_rows
from agribot.description.field_settings import (
    CropSettings,
    FieldSettings,
    RowsSettings,
    WeedsSettings,
)

SEEDS = 2**31
ROWS = RowsSettings(count=3, length_m=6.0, pitch_m=0.5, yaw_deg=0.0)
MIDDLE_ROW = 1


class PlantScene(msgspec.Struct, frozen=True, kw_only=True):
    """Rows of one crop: how tall, how far apart in the row, and among how many weeds."""

    name: str
    species: str = "sugar_beet"
    height_m: float
    spacing_m: float
    weeds_per_m2: float = 5.0


def _list_scenes() -> tuple[PlantScene, ...]:
    beets = ((0.04, 0.09), (0.07, 0.09), (0.10, 0.12), (0.15, 0.18), (0.20, 0.20), (0.25, 0.25))
    others = (
        ("lettuce", 0.15, 0.25), ("maize", 0.25, 0.18), ("carrot", 0.12, 0.05),
        ("onion", 0.18, 0.10),
    )  # fmt: skip
    weedy = (("clean", 1.0), ("weeds-20", 20.0), ("weeds-40", 40.0), ("weeds-90", 90.0))
    return (
        *(
            PlantScene(
                name=f"beet-{round(100 * height_m)}-{round(100 * spacing_m)}",
                height_m=height_m,
                spacing_m=spacing_m,
            )
            for height_m, spacing_m in beets
        ),
        *(
            PlantScene(name=species, species=species, height_m=height_m, spacing_m=spacing_m)
            for species, height_m, spacing_m in others
        ),
        *(
            PlantScene(name=name, height_m=0.12, spacing_m=0.20, weeds_per_m2=weeds_per_m2)
            for name, weeds_per_m2 in weedy
        ),
    )


SCENES = {scene.name: scene for scene in _list_scenes()}


def make_stream(scene: PlantScene, seed: int) -> np.random.Generator:
    """Make the random stream of a scene, which no other scene changes."""
    return np.random.default_rng([seed, zlib.crc32(scene.name.encode())])


def draw_field(
    scene: PlantScene, preset_name: str, rng: np.random.Generator
) -> tuple[WorldSpec, Row]:
    """Draw a field of a scene in the conditions of a preset, and the true line of its middle row.

    Plants are as tall as the scene says: nothing is drawn of their growth.

    Raises: ConfigError: there is no such preset.
    """
    preset = msgspec.structs.replace(load_condition_preset(preset_name), growth_ratio=(1.0, 1.0))
    seed, rows = int(rng.integers(SEEDS)), lay_parallel_rows(ROWS)
    drawn = draw_conditions(preset, seed, rows)
    world = alter_world(generate_field(plan_scene(scene), seed), rows, preset, drawn, seed)
    return world, drawn.find_true_row(rows[MIDDLE_ROW])


def plan_scene(scene: PlantScene) -> FieldSettings:
    return FieldSettings(
        name=scene.name,
        rows=ROWS,
        crop=CropSettings(
            species=scene.species,
            spacing_m=scene.spacing_m,
            height_m=scene.height_m,
            height_spread_ratio=0.2,
            jitter_m=0.01,
            missing_ratio=0.03,
        ),
        weeds=WeedsSettings(
            density_per_m2=scene.weeds_per_m2,
            height_min_m=0.03,
            height_max_m=0.12,
            crop_distance_m=0.03,
            cluster_ratio=0.3,
        ),
    )
