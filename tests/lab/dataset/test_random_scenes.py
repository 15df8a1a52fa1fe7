"""The scenes that networks are trained on: each seed must keep giving the scene it always gave."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.sim.flora.species import SPECIES
from agribot.sim.random_scenes import WIDE, sample_field, sample_look, sample_view

# A seed, then what was drawn from it when the shipped network was trained.
KNOWN = [
    ([0, 0, 0], 141, "lettuce", (-3.94151312683399, -1.8801479146199587), 15, 1.1475019875350767,
     2134355811),
    ([3, 101, 7], 194, "maize", (-3.457284544058325, -2.2082416199420223), 21, 1.3262094588975746,
     561307681),
]  # fmt: skip


def test_wide_fields_have_every_species_and_litter_on_the_soil() -> None:
    fields = [sample_field(np.random.default_rng([8, k]), variety=WIDE) for k in range(40)]
    species = {plant.species for field in fields for plant in field.plants}
    assert species == set(SPECIES)
    for plant in (plant for field in fields for plant in field.plants):
        assert plant.plant == SPECIES[plant.species].plant
    for litter in ("residue_ratio", "stones_ratio", "wet_ratio"):
        there = [getattr(field.soil, litter) for field in fields]
        assert 0.2 < np.mean([ratio > 0.0 for ratio in there]) < 0.8
        assert max(there) <= 1.0


@pytest.mark.parametrize(("seed", "plants", "crop", "place_m", "soil", "hfov_rad", "after"), KNOWN)
def test_a_seed_gives_the_scene_it_always_gave(
    seed: list[int], plants: int, crop: str, place_m: tuple[float, float], soil: int,
    hfov_rad: float, after: int,
) -> None:  # fmt: skip
    rng = np.random.default_rng(seed)
    world, look = sample_field(rng), sample_look(rng)
    camera, _ = sample_view(rng)
    assert (len(world.plants), world.plants[0].species) == (plants, crop)
    assert (world.plants[0].x_map_m, world.plants[0].y_map_m) == pytest.approx(place_m)
    assert look.texture_seed == soil
    assert camera.hfov_rad == pytest.approx(hfov_rad)
    assert int(rng.integers(2**31)) == after  # as many numbers were drawn, in the same order
