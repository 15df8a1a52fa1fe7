from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.perceive.instances import plant_recall, plants_in
from agribot.core.messages import PlantClass

SOIL, WEED, CROP = PlantClass.SOIL, PlantClass.WEED, PlantClass.CROP


def test_plants_have_centre_area_box_and_confidence() -> None:
    class_id = np.full((40, 60), SOIL, np.uint8)
    class_id[10:14, 20:30] = CROP
    class_id[30:36, 5:11] = WEED
    class_id[0, 59] = WEED  # one pixel is no plant
    confidence = np.full((40, 60), 255, np.uint8)
    confidence[30:36, 5:11] = 153
    weed, crop = plants_in(class_id, confidence, least_px=4)
    assert (weed.plant, crop.plant) == (WEED, CROP)
    assert (weed.u_px, weed.v_px, weed.area_px) == (7.5, 32.5, 36)
    assert (crop.u_px, crop.v_px, crop.area_px) == (24.5, 11.5, 40)
    assert (crop.left_px, crop.top_px, crop.width_px, crop.height_px) == (20, 10, 10, 4)
    assert (weed.confidence, crop.confidence) == pytest.approx((0.6, 1.0))


def test_plants_that_touch_at_a_corner_are_one() -> None:
    class_id = np.full((6, 6), SOIL, np.uint8)
    class_id[0:3, 0:3] = class_id[3:6, 3:6] = WEED
    assert len(plants_in(class_id, np.full((6, 6), 255, np.uint8), 1)) == 1


def test_every_true_plant_is_right_confused_or_missed() -> None:
    truth = np.full((20, 60), SOIL, np.uint8)
    guess = truth.copy()
    for column, (true, said) in enumerate([(WEED, WEED), (WEED, CROP), (WEED, SOIL), (CROP, CROP)]):
        block = (slice(5, 15), slice(15 * column, 15 * column + 10))
        truth[block], guess[block] = true, said
    recall = plant_recall(truth, guess, least_px=50)
    assert (recall["weed"].right, recall["weed"].confused, recall["weed"].missed) == (1, 1, 1)
    assert (recall["crop"].right, recall["crop"].confused, recall["crop"].missed) == (1, 0, 0)
    assert plant_recall(truth, guess, least_px=101)["weed"].right == 0


def test_bare_soil_has_no_plants() -> None:
    bare = np.full((8, 8), SOIL, np.uint8)
    assert plants_in(bare, bare, 1) == []
    assert plant_recall(bare, bare, 1)["crop"].missed == 0
