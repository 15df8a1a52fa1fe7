"""Fields as a front camera sees them: what stands there, and what the camera looks at."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.core.messages import PlantClass
from agribot.sim.camera.flints import add_flints
from agribot.sim.front_scenes import (
    AHEAD_M,
    BEHIND_M,
    sample_front_field,
    sample_front_look,
    sample_front_view,
)

FIELDS, VIEWS = 12, 200


def test_the_crop_of_a_field_stands_in_rows_and_no_weed_is_of_its_species() -> None:
    for k in range(FIELDS):
        plants = sample_front_field(np.random.default_rng([5, k])).plants
        crops = [plant for plant in plants if plant.plant == PlantClass.CROP]
        weeds = {plant.species for plant in plants if plant.plant == PlantClass.WEED}
        (species,) = {plant.species for plant in crops}
        assert species not in weeds and 1 <= len(weeds) <= 4
        y_m = np.sort([plant.y_map_m for plant in crops])
        gaps_m = np.diff(y_m)
        assert (gaps_m > 0.15).sum() >= 7  # the ground between rows
        x_m = np.array([plant.x_map_m for plant in crops])
        assert x_m.min() < 0.5 and AHEAD_M - 1.0 < x_m.max() < AHEAD_M + 0.5
        assert x_m.min() > -BEHIND_M - 0.5


def test_cameras_look_ahead_along_the_rows_most_of_them_far() -> None:
    views = [sample_front_view(np.random.default_rng([6, k])) for k in range(VIEWS)]
    height_m = np.array([place[2, 3] for _, place in views])
    ahead = np.array([place[:3, 2] for _, place in views])  # the optical axis in the map
    assert height_m.min() >= 0.4 and height_m.max() <= 1.5
    assert (ahead[:, 0] > 0.0).all()
    assert (ahead[:, 2] < 0.0).all()
    tilt_deg = np.degrees(np.arcsin(-ahead[:, 2]))
    assert 0.6 < np.mean(tilt_deg < 40.0) < 0.95


def test_two_fields_of_three_are_stony() -> None:
    looks = [sample_front_look(np.random.default_rng([7, k])) for k in range(VIEWS)]
    assert np.mean([look.flint_cover_ratio > 0.0 for look in looks]) == pytest.approx(0.65, abs=0.1)


def test_more_flints_cover_more_of_the_soil_and_leave_the_rest_as_it_was() -> None:
    colour, height = np.full((512, 512, 3), 80.0), np.zeros((512, 512))
    covers = []
    for ratio in (0.1, 0.4):
        shown, raised = add_flints((colour, height), ratio, seed=3)
        is_stone = raised > 0.0
        covers.append(is_stone.mean())
        assert (shown[~is_stone] == 80.0).all()
        assert raised[is_stone].max() <= 10.0
    assert 0.05 < covers[0] < 0.2 and 0.25 < covers[1] < 0.65
    again, _ = add_flints((colour, height), 0.4, seed=3)
    np.testing.assert_array_equal(again, shown)
