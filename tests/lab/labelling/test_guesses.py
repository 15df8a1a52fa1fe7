"""What a network says of a photograph before a person labels it."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.picture_stems import OwnedPixels
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.labelling.guesses import Guess, guess_picture, measure_doubt
from tests.autonomy.perceive.drawn_field import MAP_SHAPE
from tests.autonomy.perceive.drawn_plants import draw_plants

BEET, THISTLE = (0.9, 0.15, 0.06, PlantClass.CROP), (0.9, -0.15, 0.06, PlantClass.WEED)
PICTURE = np.zeros((2 * MAP_SHAPE[0], 2 * MAP_SHAPE[1], 3), np.uint8)
SURE = 230  # of 255, for every pixel


class Network:
    """Calls every other column of the beet's leaves a weed."""

    map_shape = MAP_SHAPE

    def __init__(self, *, finds_stems: bool = True) -> None:
        seen = draw_plants(BEET, THISTLE)
        class_id = seen.class_id.copy()
        striped = class_id[:, ::8]
        striped[striped == PlantClass.CROP] = PlantClass.WEED
        self.seen = msgspec.structs.replace(
            seen,
            class_id=class_id,
            confidence=np.full(MAP_SHAPE, SURE, np.uint8),
            plants=seen.plants if finds_stems else None,
        )

    def segment(self, image_rgb: ByteArray) -> ClassMap:
        return self.seen


def guess(*, finds_stems: bool = True) -> Guess:
    return guess_picture(Network(finds_stems=finds_stems), PICTURE)


def test_all_leaves_of_a_plant_have_its_number_out_to_their_edges_whatever_they_are_called() -> (
    None
):
    found = guess()
    assert found.plant.shape == found.class_id.shape == PICTURE.shape[:2]
    middle = PICTURE.shape[1] // 2
    left, right = found.plant[:, :middle], found.plant[:, middle:]
    is_plant = found.class_id != PlantClass.SOIL
    beet, thistle = np.unique(left[is_plant[:, :middle]]), np.unique(right[is_plant[:, middle:]])
    assert sorted([*beet.tolist(), *thistle.tolist()]) == [1, 2]  # none has 0, none two
    assert not found.plant[~is_plant].any()
    assert set(np.unique(found.class_id[:, :middle]).tolist()) == {0, 1, 2}


def test_a_network_without_stems_numbers_no_plant() -> None:
    assert not guess(finds_stems=False).plant.any()


def test_doubt_is_that_of_the_vegetation_however_much_sure_soil_there_is() -> None:
    class_id = np.full((100, 100), PlantClass.SOIL, np.uint8)
    confidence = np.full((100, 100), 255, np.uint8)
    assert measure_doubt(class_id, confidence, None) == 0.0
    class_id[0, :10], confidence[0, :10] = PlantClass.WEED, 153
    assert measure_doubt(class_id, confidence, None) == pytest.approx(0.4)
    class_id[50, :10], confidence[50, :10] = PlantClass.CROP, 51
    assert measure_doubt(class_id, confidence, None) == pytest.approx((0.4 + 0.8) / 2)


def test_two_names_on_one_plant_are_a_doubt_though_each_pixel_is_sure() -> None:
    class_id = np.full((3, 10), PlantClass.SOIL, np.uint8)
    confidence = np.full((3, 10), 255, np.uint8)
    number = np.zeros((3, 10), np.int32)
    class_id[0], class_id[1], number[:2] = PlantClass.CROP, PlantClass.WEED, 1
    class_id[2, :5], confidence[2, :5] = PlantClass.WEED, 153  # of no plant that has a stem
    owned = OwnedPixels(number, np.array([[4.0, 1.0]]), np.array([[0.1, 0.9]]))  # a crop, by 0.9
    expected = (10 * 0.1 + 10 * 0.9 + 5 * 0.4) / 25
    assert measure_doubt(class_id, confidence, owned) == pytest.approx(expected)
