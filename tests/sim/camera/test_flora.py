"""The plants themselves: size, shape, levels of detail and textures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from agribot.core.messages import PlantClass
from agribot.sim.flora.fronds import (
    grow_carrot,
    grow_chamomile,
    grow_mayweed,
    grow_parsley,
)
from agribot.sim.flora.habit import SEEDLING_STAGE, STAGES, stem_blade
from agribot.sim.flora.mesh import Leaves, Mesh
from agribot.sim.flora.species import (
    LODS,
    SPECIES,
    build_plant_lods,
    build_plant_mesh,
    find_nearest_stage,
)
from agribot.sim.flora.texture import build_leaf_atlas, make_tileable_noise
from agribot.sim.flora.weeds import grow_millet, grow_quickweed
from tests import nightly

Grow = Callable[[np.random.Generator, float], list[Leaves]]

EVERY_SPECIES = pytest.mark.parametrize("species", sorted(SPECIES))


def _leaf_area(mesh: Mesh) -> float:
    corner = mesh.vertices_m[mesh.faces].astype(float)
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return float(0.5 * np.linalg.norm(cross, axis=1).sum())


def test_there_are_crops_and_weeds() -> None:
    crops = {name for name, kind in SPECIES.items() if kind.plant == PlantClass.CROP}
    assert crops == {
        "sugar_beet", "maize", "lettuce", "carrot", "onion", "parsley", "fodder_beet",
    }  # fmt: skip
    assert set(SPECIES) - crops == {
        "grass", "goosefoot", "thistle", "amaranth", "chickweed", "plantain", "charlock",
        "chamomile", "millet", "knotweed", "quickweed", "milk_thistle",
        "mayweed",
    }  # fmt: skip


@EVERY_SPECIES
def test_plants_have_unit_height_and_sound_meshes(species: str) -> None:
    for variant in range(4):
        for stage in SPECIES[species].stages:
            finest, *coarser = build_plant_lods(species, variant, stage)
            assert finest.height_m == pytest.approx(1.0, abs=1e-5)
            assert all(0.55 < mesh.height_m < 1.4 for mesh in coarser)
            for mesh in (finest, *coarser):
                assert mesh.faces.min() >= 0
                assert mesh.faces.max() < len(mesh.vertices_m)
                length = np.linalg.norm(mesh.normals, axis=1)
                assert ((length < 1.0001) & (length > 0.99)).mean() > 0.98
                assert mesh.uv.min() >= 0.0
                assert mesh.uv.max() <= 1.0


@EVERY_SPECIES
def test_coarser_levels_have_fewer_faces_and_about_the_same_leaf_area(species: str) -> None:
    for variant in range(4):
        meshes = build_plant_lods(species, variant, 1.0)
        faces = [len(mesh.faces) for mesh in meshes]
        assert faces == sorted(faces, reverse=True)
        assert faces[-1] <= 10
        areas = np.array([_leaf_area(mesh) for mesh in meshes[: LODS - 1]])
        assert (areas / areas[0] > 0.4).all()
        assert (areas / areas[0] < 1.7).all()


@EVERY_SPECIES
def test_variants_differ_and_repeat(species: str) -> None:
    first = build_plant_mesh(species, 3, 0, 1.0)
    build_plant_lods.cache_clear()
    again = build_plant_mesh(species, 3, 0, 1.0)
    np.testing.assert_array_equal(first.vertices_m, again.vertices_m)
    other = build_plant_mesh(species, 4, 0, 1.0)
    same_shape = first.vertices_m.shape == other.vertices_m.shape
    assert not (same_shape and np.allclose(first.vertices_m, other.vertices_m))


@nightly.all_or_first("variants", range(8), in_suite=3, unit="variants")
def test_grown_plants_have_more_leaves_than_seedlings(variants: Sequence[int]) -> None:
    for species in SPECIES:
        young, grown = (
            np.mean([len(build_plant_mesh(species, k, 3, stage).faces) for k in variants])
            for stage in (STAGES[0], STAGES[-1])
        )
        assert grown > 1.5 * young, species


def test_only_a_young_carrot_has_its_two_long_seed_leaves() -> None:
    def kinds(stage: float) -> list[Leaves]:
        return grow_carrot(np.random.default_rng(3), stage)

    young, grown = kinds(STAGES[0]), kinds(STAGES[-1])
    longest_frond = young[0].length.max()
    seed_leaves = [kind for kind in young if len(kind.length) == 2 and kind is young[-1]]
    assert seed_leaves and (seed_leaves[0].length > 0.8 * longest_frond).all()
    assert {len(kind.length) for kind in grown} == {len(grown[0].length)}, "fronds and their parts"


def test_the_first_leaves_of_a_carrot_are_fans_in_the_ring_of_its_seed_leaves() -> None:
    """Its lobes start near each other, far from the stem, and point away from it."""
    for seed in range(10):
        kinds = grow_carrot(np.random.default_rng(seed), SEEDLING_STAGE)
        fronds, seed_leaves = kinds[0], kinds[-1]
        assert 2 <= len(fronds.length) <= 6 and len(seed_leaves.length) == 2
        lobes = [kind for kind in kinds[2:-1] if kind.profile is not stem_blade]
        for k in range(len(fronds.length)):
            feet_m = np.array([kind.base[k] for kind in lobes])
            assert np.hypot(*feet_m[:, :2].T).min() > 0.25 * np.hypot(*feet_m[:, :2].T).max()
            aside = [math.cos(kind.yaw_rad[k] - fronds.yaw_rad[k]) for kind in lobes]
            assert np.mean(aside) > 0.4


def test_young_chamomile_and_half_of_the_knotweed_lie_flat_on_the_ground() -> None:
    def reach(species: str, variant: int) -> float:
        """Width of a plant over its height, seen from above."""
        mesh = build_plant_mesh(species, variant, 0, SEEDLING_STAGE)
        return float(np.ptp(mesh.vertices_m[:, :2], axis=0).max() / mesh.height_m)

    wide = {name: [reach(name, k) for k in range(20)] for name in ("carrot", "chamomile")}
    assert np.median(wide["chamomile"]) > 1.1 * np.median(wide["carrot"])
    creeping = [reach("knotweed", k) > 4.5 for k in range(20)]
    assert 5 <= sum(creeping) <= 15


def test_chamomile_covers_less_of_its_outline_than_carrot() -> None:
    def cover(species: str) -> float:
        """Leaf area from near over that of the outlines."""
        near, far = build_plant_mesh(species, 1, 0, 0.6), build_plant_mesh(species, 1, 3, 0.6)
        return _leaf_area(near) / _leaf_area(far)

    assert cover("chamomile") < cover("carrot")


def test_lobes_are_threads_in_mayweed_and_broad_in_parsley() -> None:
    def broadest(grow: Grow) -> float:
        """Width over length of the broadest parts of the fronds, in the mean of ten plants."""
        plants = [grow(np.random.default_rng(seed), 0.6) for seed in range(10)]
        parts = [max((kind.width / kind.length).mean() for kind in kinds[1:]) for kinds in plants]
        return float(np.mean(parts))

    of_all = [broadest(grow) for grow in (grow_mayweed, grow_chamomile, grow_carrot, grow_parsley)]
    assert of_all == sorted(of_all)
    assert of_all[0] < 0.2 and of_all[-1] > 0.5


def test_a_seedling_of_millet_is_a_few_long_straps() -> None:
    for seed in range(8):
        (blades,) = grow_millet(np.random.default_rng(seed), STAGES[0])
        assert 2 <= len(blades.length) <= 5
        assert (blades.length > 5.0 * blades.width).all()


def test_leaves_of_quickweed_stand_in_pairs_that_cross() -> None:
    (blades,) = grow_quickweed(np.random.default_rng(5), STAGES[-1])
    one, other = blades.yaw_rad[::2], blades.yaw_rad[1::2]
    assert (np.cos(one - other) < -0.6).all(), "two leaves of a pair opposite each other"
    assert (np.abs(np.cos(np.diff(one))) < 0.7).all(), "and the next pair across"


def test_the_veins_of_milk_thistle_are_brighter_than_its_leaves() -> None:
    atlas = build_leaf_atlas(3)
    brightness = atlas.mean(axis=-1)[:, 60:, :]  # without petioles
    spread = np.percentile(brightness, 97, axis=(1, 2)) - np.median(brightness, axis=(1, 2))
    assert spread.argmax() == list(SPECIES).index("milk_thistle")


def test_height_tells_the_growth_stage() -> None:
    assert find_nearest_stage("sugar_beet", 0.25) == 1.0
    assert find_nearest_stage("sugar_beet", 0.05) == STAGES[0]
    assert find_nearest_stage("maize", 0.25) == STAGES[0]
    assert find_nearest_stage("carrot", 0.02) == SEEDLING_STAGE
    assert find_nearest_stage("carrot", 0.05) == STAGES[0]
    assert find_nearest_stage("maize", 0.02) == STAGES[0], "its seedlings are small plants"


def test_noise_tiles_and_has_unit_deviation() -> None:
    noise = make_tileable_noise(np.random.default_rng(1), (128, 128), exponent=1.5)
    assert noise.std() == pytest.approx(1.0)
    seam = np.abs(noise[:, 0] - noise[:, -1]).mean()
    inside = np.abs(np.diff(noise, axis=1)).mean()
    assert seam < 1.5 * inside


def test_leaf_atlas_is_green_varied_and_repeats() -> None:
    atlas = build_leaf_atlas(3)
    assert atlas.shape[0] == len(SPECIES)
    mean = atlas.mean(axis=(1, 2))
    assert (mean[:, 1] > mean[:, 0]).all()
    assert (mean[:, 1] > mean[:, 2]).all()
    build_leaf_atlas.cache_clear()
    np.testing.assert_array_equal(atlas, build_leaf_atlas(3))
    assert not np.array_equal(atlas, build_leaf_atlas(4))
