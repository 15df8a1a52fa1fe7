"""Fields as a front camera sees them: what stands there, and what the camera looks at."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.core.messages import PlantClass
from agribot.core.world import Plant
from agribot.sim.camera.flints import add_flints
from agribot.sim.front_scenes import (
    AHEAD_M,
    BEHIND_M,
    sample_front_field,
    sample_front_look,
    sample_front_view,
)

FIELDS, VIEWS = 12, 200


def list_kind(k: int, kind: PlantClass) -> list[Plant]:
    plants = sample_front_field(np.random.default_rng([5, k])).plants
    return [plant for plant in plants if plant.plant == kind]


def test_the_crop_of_a_field_is_one_species_in_rows_to_the_end_of_the_field() -> None:
    for k in range(FIELDS):
        crops = list_kind(k, PlantClass.CROP)
        assert len({plant.species for plant in crops}) == 1
        gaps_m = np.diff(np.sort([plant.y_map_m for plant in crops]))
        assert (gaps_m > 0.15).sum() >= 7  # the ground between rows
        x_m = np.array([plant.x_map_m for plant in crops])
        assert x_m.min() < 0.5 and AHEAD_M - 1.0 < x_m.max() < AHEAD_M + 0.5
        assert x_m.min() > -BEHIND_M - 0.5


def test_weeds_of_the_crops_own_species_stand_between_the_rows() -> None:
    with_volunteers = 0
    for k in range(FIELDS):
        crops, weeds = list_kind(k, PlantClass.CROP), list_kind(k, PlantClass.WEED)
        volunteers = [plant for plant in weeds if plant.species == crops[0].species]
        assert 1 <= len({plant.species for plant in weeds}) <= 5
        with_volunteers += bool(volunteers)
        rows_y_m = np.array([plant.y_map_m for plant in crops])
        for plant in volunteers:
            assert np.abs(np.median(np.sort(np.abs(rows_y_m - plant.y_map_m))[:5])) > 0.05
    assert 0.2 < with_volunteers / FIELDS < 0.8


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
