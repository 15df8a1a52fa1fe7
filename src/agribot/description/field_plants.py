"""Plants of generated fields: one by one, and weeds scattered over a field and in patches."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.messages import FloatArray, PlantClass
from agribot.core.world import Plant
from agribot.description.field_settings import WeedsSettings

SEEDS = 2**31
DIGITS = 6  # digits of a place: rounded to a micrometre, so that every machine writes the same file
WEED_STREAM = 4  # number among the random streams of a world's seed, beside those of `scatter.py`


def make_plant(
    species: str, kind: PlantClass, at_m: FloatArray, height_m: float, stem_radius_m: float,
    rng: np.random.Generator,
) -> Plant:  # fmt: skip
    """Make a plant at a place (2,) of the map, with leaves of its own."""
    return Plant(
        species=species,
        plant=kind,
        x_map_m=round(float(at_m[0]), DIGITS),
        y_map_m=round(float(at_m[1]), DIGITS),
        yaw_rad=round(float(rng.uniform(-math.pi, math.pi)), DIGITS),
        size_m=round(height_m, DIGITS),
        seed=int(rng.integers(SEEDS)),
        stem_radius_m=stem_radius_m,
    )


def make_weed(weeds: WeedsSettings, at_m: FloatArray, rng: np.random.Generator) -> Plant:
    """Make a weed of one of the species and a height between the two of the settings."""
    species = weeds.species[int(rng.integers(len(weeds.species)))]
    height_m = float(rng.uniform(weeds.height_min_m, weeds.height_max_m))
    return make_plant(species, PlantClass.WEED, at_m, height_m, 0.02, rng)


def place_weeds(
    weeds: WeedsSettings, crops_xy_m: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Place weeds off the crops (m, 2), scattered and in patches; return positions, (n, 2)."""
    low, high = crops_xy_m.min(axis=0) - weeds.margin_m, crops_xy_m.max(axis=0) + weeds.margin_m
    total = weeds.density_per_m2 * float(np.prod(high - low))
    scattered = rng.uniform(low, high, (int(rng.poisson(total * (1.0 - weeds.cluster_ratio))), 2))
    patches = int(rng.poisson(total * weeds.cluster_ratio / weeds.cluster_size))
    middles = rng.uniform(low, high, (patches, 2))
    sizes = rng.poisson(weeds.cluster_size, patches)
    around = rng.normal(0.0, weeds.cluster_radius_m / 2.0, (int(sizes.sum()), 2))
    places = np.concatenate([scattered, np.repeat(middles, sizes, axis=0) + around])
    free = np.ones(len(places), dtype=bool)
    for index, place in enumerate(places):
        gaps_m = np.hypot(*(crops_xy_m - place).T)
        free[index] = bool(gaps_m.min() >= weeds.crop_distance_m)
    kept: FloatArray = places[free & np.all((places >= low) & (places <= high), axis=1)]
    return kept


def replace_weeds(plants: Sequence[Plant], density_per_m2: float, seed: int) -> tuple[Plant, ...]:
    """Replace the weeds of a field by others of their species and heights, as dense as asked.

    The density is that of the crops' rectangle and a margin, as of a generated field. Crops stay.
    Raises: DescriptionError: there is no crop to put weeds around.
    """
    crops = [plant for plant in plants if plant.plant == PlantClass.CROP]
    if not density_per_m2:
        return tuple(crops)
    if not crops:
        raise DescriptionError(
            f"sim.weed_density_per_m2 = {density_per_m2:g}, but the world has neither an "
            "<agribot:weeds> area nor a crop to put weeds around; set it to 0 or add one of them"
        )
    weeds = _describe([plant for plant in plants if plant.plant == PlantClass.WEED])
    weeds = msgspec.structs.replace(weeds, density_per_m2=density_per_m2)
    rng = np.random.default_rng([seed, WEED_STREAM])
    places = place_weeds(weeds, np.array([(p.x_map_m, p.y_map_m) for p in crops]), rng)
    return (*crops, *(make_weed(weeds, at_m, rng) for at_m in places))


def _describe(weeds: Sequence[Plant]) -> WeedsSettings:
    """Describe weeds by their species and heights; without any, those of a generated field."""
    if not weeds:
        return WeedsSettings()
    heights_m = [weed.size_m for weed in weeds]
    return WeedsSettings(
        species=tuple(dict.fromkeys(weed.species for weed in weeds)),
        height_min_m=min(heights_m),
        height_max_m=max(heights_m),
    )
