"""Plants by chance: repeatable, as dense as asked, and crops untouched by the weeds."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from agribot.core.errors import DescriptionError
from agribot.core.messages import PlantClass
from agribot.core.world import Plant
from agribot.description.field_settings import WeedsSettings
from agribot.description.worlds_sdf import load_world
from tests import nightly

AREA_M2 = 12.0 * 6.0


@functools.cache
def _weeds(seed: int, density: float | None = None) -> list[Plant]:
    world = load_world("Farm", seed=seed, weed_density_per_m2=density)
    return [p for p in world.plants if p.plant == PlantClass.WEED]


def _crops(seed: int, density: float | None = None) -> list[Plant]:
    world = load_world("Farm", seed=seed, weed_density_per_m2=density)
    return [p for p in world.plants if p.plant == PlantClass.CROP]


def test_same_seed_grows_the_same_field() -> None:
    assert load_world("Farm", seed=7).plants == load_world("Farm", seed=7).plants


def test_another_seed_grows_other_weeds_and_other_leaves_on_the_same_places() -> None:
    assert _weeds(1) != _weeds(2)
    first, second = _crops(1), _crops(2)
    assert [(p.x_map_m, p.y_map_m) for p in first] == [(p.x_map_m, p.y_map_m) for p in second]
    assert [p.seed for p in first] != [p.seed for p in second]


def test_weed_density_does_not_change_the_crops() -> None:
    assert _crops(3, 0.0) == _crops(3, 4.0) == _crops(3)


def test_no_weeds_where_none_are_asked_for() -> None:
    assert _weeds(5, 0.0) == []


@nightly.one_by_one("density", [None, 4.0, 0.5], in_suite=1)
def test_number_of_weeds_is_the_density_times_the_area(density: float | None) -> None:
    """Poisson: over n fields the mean is within 4 sigma, and variance equals mean within 50 %."""
    fields = 60
    counts = np.array([len(_weeds(seed, density)) for seed in range(fields)])
    expected = (1.5 if density is None else density) * AREA_M2
    assert abs(counts.mean() - expected) < 4 * np.sqrt(expected / fields)
    assert 0.5 < counts.var(ddof=1) / expected < 1.6


def test_weeds_are_spread_evenly_over_the_field() -> None:
    """Quadrant counts of many fields differ by no more than chance allows."""
    places = np.array([(w.x_map_m, w.y_map_m) for seed in range(40) for w in _weeds(seed, None)])
    quadrant = (places[:, 0] > 3.5).astype(int) * 2 + (places[:, 1] > 7.0).astype(int)
    counts = np.bincount(quadrant, minlength=4)
    expected = len(places) / 4
    assert ((counts - expected) ** 2 / expected).sum() < 16.3  # chi-square, 3 degrees, 0.1 %


def test_density_without_an_area_or_a_crop_to_put_weeds_around_is_refused() -> None:
    with pytest.raises(DescriptionError, match=r"weed_density_per_m2 = 2.*agribot:weeds.*crop"):
        load_world("empty", weed_density_per_m2=2.0)
    assert load_world("empty", weed_density_per_m2=0.0).plants == ()


def test_weeds_that_a_generated_field_lists_are_replaced_by_as_many_as_asked() -> None:
    """The packaged beet field lists its weeds one by one, over 6 x 13 m2 and more."""
    listed = load_world("beet").plants
    crops = [plant for plant in listed if plant.plant == PlantClass.CROP]
    xy_m = np.array([(plant.x_map_m, plant.y_map_m) for plant in crops])
    area_m2 = float(np.prod(np.ptp(xy_m, axis=0) + 2 * WeedsSettings().margin_m))
    for density_per_m2 in (0.0, 6.0):
        plants = load_world("beet", seed=1, weed_density_per_m2=density_per_m2).plants
        weeds = [plant for plant in plants if plant.plant == PlantClass.WEED]
        assert [plant for plant in plants if plant.plant == PlantClass.CROP] == crops
        # Up to a fifth falls on the discs of 10 cm around the crops, where none grows.
        assert 0.75 * density_per_m2 * area_m2 <= len(weeds) <= 1.1 * density_per_m2 * area_m2
        assert {weed.species for weed in weeds} <= {plant.species for plant in listed}
