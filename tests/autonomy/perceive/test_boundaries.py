from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.perceive.boundaries import TOLERANCE_RATIO, boundary_counts, boundary_f1
from agribot.core.messages import ByteArray, PlantClass

SHAPE = (300, 400)
TOLERANCE_PX = TOLERANCE_RATIO * math.hypot(*SHAPE)  # 3.75


def plant_at(left_px: int, size_px: int = 60, kind: PlantClass = PlantClass.CROP) -> ByteArray:
    """A square plant on bare soil."""
    class_id = np.full(SHAPE, PlantClass.SOIL, dtype=np.uint8)
    class_id[100 : 100 + size_px, left_px : left_px + size_px] = kind
    return class_id


def crop_f1(truth: ByteArray, guess: ByteArray) -> float | None:
    return boundary_f1(boundary_counts(truth, guess))[PlantClass.CROP]


def test_the_same_map_meets_every_outline_and_a_class_without_one_has_no_score() -> None:
    weed, crop, soil = boundary_f1(boundary_counts(plant_at(150), plant_at(150)))
    assert (weed, crop, soil) == (None, 1.0, 1.0)


def test_a_shift_within_the_tolerance_is_forgiven_and_a_larger_one_is_not() -> None:
    truth = plant_at(150)
    assert crop_f1(truth, plant_at(150 + math.floor(TOLERANCE_PX))) == 1.0
    # Only the two sides that run along the shift are met still, and the ends of the others.
    shifted = crop_f1(truth, plant_at(150 + math.ceil(TOLERANCE_PX) + 6))
    assert shifted is not None
    assert 0.45 < shifted < 0.6
    assert crop_f1(truth, plant_at(250)) == 0.0


def test_an_outline_of_a_plant_that_is_not_there_costs_precision_alone() -> None:
    truth, guess = plant_at(50), np.minimum(plant_at(50), plant_at(250))
    said, right, true, met = boundary_counts(truth, guess)[PlantClass.CROP]
    assert (said, right) == (2 * true, true)
    assert met == true
    assert crop_f1(truth, guess) == pytest.approx(2.0 / 3.0)
    assert crop_f1(guess, truth) == pytest.approx(2.0 / 3.0)


def test_a_plant_called_another_class_has_no_outline_of_its_own() -> None:
    weed, crop, soil = boundary_f1(
        boundary_counts(plant_at(150), plant_at(150, kind=PlantClass.WEED))
    )
    assert (weed, crop, soil) == (0.0, 0.0, 1.0)


def test_a_square_is_outlined_by_its_rim_and_not_by_the_edge_of_the_picture() -> None:
    inside = plant_at(150, 60)
    assert boundary_counts(inside, inside)[PlantClass.CROP][2] == 4 * 60 - 4
    at_edge = plant_at(SHAPE[1] - 60, 60)
    assert boundary_counts(at_edge, at_edge)[PlantClass.CROP][2] == 3 * 60 - 2


def test_what_is_not_labelled_neither_counts_nor_makes_an_outline() -> None:
    truth = plant_at(150)
    truth[:, 180:] = 255
    counts = boundary_counts(truth, plant_at(150))[PlantClass.CROP]
    assert counts.tolist() == [2 * 30 + 58, 2 * 30 + 58, 2 * 30 + 58, 2 * 30 + 58]
