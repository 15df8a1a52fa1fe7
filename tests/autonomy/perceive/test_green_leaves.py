"""Leaves that a network calls soil show by the colour of the plants that it finds."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.green_leaves import find_green_leaves
from agribot.core.messages import ByteArray, PlantClass
from tests.autonomy.perceive.drawn_rows import PLANT_RGB, SOIL_RGB

SHAPE = (96, 128)
FOUND, MISSED = np.s_[:48, :64], np.s_[:48, 64:]


def draw(plant_rgb: tuple[int, int, int] = PLANT_RGB, finer: int = 1) -> ByteArray:
    """Draw plants over the upper half of a picture, and soil below."""
    picture = np.full((*SHAPE, 3), SOIL_RGB, np.uint8)
    picture[:48] = plant_rgb
    return picture.repeat(finer, axis=0).repeat(finer, axis=1)


def see(sure: float = 0.7) -> ClassMap:
    """See the plants on the left, and soil elsewhere; the probability of soil is `sure`."""
    class_id = np.full(SHAPE, PlantClass.SOIL, np.uint8)
    class_id[FOUND] = PlantClass.WEED
    confidence = np.full(SHAPE, round(255 * sure), np.uint8)
    return ClassMap(class_id=class_id, confidence=confidence, scale_px=(1.0, 1.0))


@pytest.mark.parametrize("finer", [1, 3])
def test_what_is_as_green_as_the_plants_is_a_leaf_and_brown_is_soil(finer: int) -> None:
    expected = np.zeros(SHAPE, np.bool_)
    expected[MISSED] = True
    assert (find_green_leaves(see(), draw(finer=finer)) == expected).all()


def test_a_network_that_is_sure_of_the_soil_is_believed() -> None:
    assert not find_green_leaves(see(0.95), draw()).any()


def test_plants_no_greener_than_soil_show_no_leaf_as_in_near_infrared() -> None:
    assert not find_green_leaves(see(), draw(plant_rgb=(200, 160, 118))).any()


def test_a_picture_without_plants_shows_no_leaf() -> None:
    soil = np.full(SHAPE, PlantClass.SOIL, np.uint8)
    class_map = ClassMap(
        class_id=soil, confidence=np.full(SHAPE, 150, np.uint8), scale_px=(1.0, 1.0)
    )
    assert not find_green_leaves(class_map, draw()).any()
