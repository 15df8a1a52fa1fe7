"""What is counted when a robot's plants are held against those that truly stand there."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.core.messages import PlantClass
from agribot.lab.plant_scores import PlacedPlants, PlantScores, PlantSegments, PlantTally

WEED, CROP = PlantClass.WEED, PlantClass.CROP
NOWHERE = np.zeros((10, 20), dtype=bool)


def _place(*plants: tuple[float, float, PlantClass]) -> PlacedPlants:
    table = np.array([plant[:2] for plant in plants]).reshape(-1, 2)
    return PlacedPlants(table, np.array([plant[2] for plant in plants], dtype=np.uint8))


def _score_plants(
    truth: PlacedPlants, answer: PlacedPlants, unjudged: PlacedPlants | None = None
) -> PlantScores:
    tally = PlantTally()
    tally.add_plants(truth, answer, unjudged)
    return tally.compute_scores()


def _cut(*columns: int, kind: PlantClass = CROP) -> PlantSegments:
    """Plants of 10 x n pixels beside each other, n given for each."""
    number = np.zeros(NOWHERE.shape, dtype=np.int64)
    edges = np.cumsum([0, *columns])
    for index in range(len(columns)):
        number[:, edges[index] : edges[index + 1]] = index + 1
    return PlantSegments(number, np.full(len(columns), kind, dtype=np.uint8))


def _score_pq(
    truth: PlantSegments, answer: PlantSegments, unjudged: np.ndarray = NOWHERE
) -> float | None:
    tally = PlantTally()
    tally.add_segments(truth, answer, unjudged)
    return tally.compute_scores().pq


def test_what_is_found_in_its_place_is_all_right() -> None:
    stand = _place((1.0, 0.0, CROP), (1.2, 0.0, CROP), (1.1, 0.1, WEED))
    scores = _score_plants(stand, stand)
    assert scores.crop_recall == scores.crop_precision == 1.0
    assert scores.weed_recall == scores.weed_precision == 1.0
    assert (scores.stem_error_median_m, scores.stem_error_p95_m, scores.crops_hit) == (0.0, 0.0, 0)


def test_a_plant_found_twice_is_found_once_and_wrong_once() -> None:
    scores = _score_plants(_place((1.0, 0.0, CROP)), _place((1.0, 0.01, CROP), (1.0, -0.03, CROP)))
    assert (scores.crop_recall, scores.crop_precision) == (1.0, 0.5)
    assert scores.stem_error_p95_m == pytest.approx(0.01)


def test_a_plant_5_cm_away_is_another_one() -> None:
    scores = _score_plants(_place((1.0, 0.0, CROP)), _place((1.051, 0.0, CROP)))
    assert (scores.crop_recall, scores.crop_precision) == (0.0, 0.0)
    assert scores.stem_error_median_m is None


def test_a_crop_called_a_weed_is_hit() -> None:
    truth = _place((1.0, 0.0, CROP), (1.2, 0.0, CROP))
    scores = _score_plants(truth, _place((1.0, 0.02, WEED), (1.2, 0.0, CROP)))
    assert scores.crops_hit == 1
    assert (scores.crop_recall, scores.weed_precision) == (0.5, 0.0)


def test_a_crop_beside_a_weed_that_is_one_is_missed_and_not_hit() -> None:
    truth = _place((1.0, 0.0, CROP), (1.0, 0.03, WEED))
    scores = _score_plants(truth, _place((1.0, 0.03, WEED)))
    assert (scores.crop_recall, scores.weed_precision, scores.crops_hit) == (0.0, 1.0, 0)


def test_a_crop_found_as_crop_and_as_weed_is_not_hit_but_the_weed_is_wrong() -> None:
    scores = _score_plants(_place((1.0, 0.0, CROP)), _place((1.0, 0.0, CROP), (1.0, 0.02, WEED)))
    assert (scores.crops_hit, scores.crop_recall, scores.weed_precision) == (0, 1.0, 0.0)


def test_an_answer_in_place_of_a_plant_that_nobody_must_find_does_not_count() -> None:
    scores = _score_plants(
        _place((1.0, 0.0, CROP)),
        _place((1.0, 0.0, CROP), (1.6, 0.01, CROP), (1.6, 0.3, CROP)),
        _place((1.6, 0.0, CROP), (1.6, 0.3, WEED)),
    )
    assert (scores.crops_truth, scores.crop_recall, scores.crop_precision) == (1, 1.0, 0.5)


def test_without_plants_there_are_no_figures() -> None:
    scores = _score_plants(_place(), _place())
    assert (scores.crop_recall, scores.weed_precision, scores.pq) == (None, None, None)


def test_perfect_segments_have_a_panoptic_quality_of_1() -> None:
    assert _score_pq(_cut(5, 7), _cut(5, 7)) == 1.0


def test_a_merged_pair_has_the_panoptic_quality_of_the_formula() -> None:
    assert _score_pq(_cut(6, 4), _cut(10)) == pytest.approx(0.6 / (1 + 0.5))
    assert _score_pq(_cut(5, 5), _cut(10)) == 0.0  # neither half is more than half


def test_a_segment_of_the_other_class_matches_nothing() -> None:
    assert _score_pq(_cut(5), _cut(5, kind=WEED)) == 0.0


def test_both_classes_weigh_the_same_in_the_panoptic_quality() -> None:
    tally = PlantTally()
    tally.add_segments(_cut(2, 2, 2, 2), _cut(2, 2, 2, 2), NOWHERE)
    tally.add_segments(_cut(8, kind=WEED), _cut(6, kind=WEED), NOWHERE)
    assert tally.compute_scores().pq == pytest.approx((1.0 + 6 / 8) / 2)


def test_pixels_that_are_not_judged_neither_help_nor_harm() -> None:
    unjudged = NOWHERE.copy()
    unjudged[:, 5:] = True
    assert _score_pq(_cut(5), _cut(8), unjudged) == 1.0
    assert _score_pq(_cut(5), _cut(5, 9), unjudged) == 1.0  # what lies in them is no answer
    assert _score_pq(_cut(5), _cut(4, 1), unjudged) == pytest.approx(0.8 / 1.5)


def test_tallies_of_two_pictures_add_up() -> None:
    one, other = PlantTally(), PlantTally()
    one.add_plants(_place((1.0, 0.0, CROP)), _place((1.0, 0.02, CROP)))
    other.add_plants(_place((1.0, 0.0, CROP), (2.0, 0.0, CROP)), _place((1.0, 0.0, WEED)))
    other.add_segments(_cut(5), _cut(5), NOWHERE)
    one.add(other)
    scores = one.compute_scores()
    assert (scores.crops_truth, scores.crops_hit, scores.pq) == (3, 1, 1.0)
    assert scores.crop_recall == pytest.approx(1 / 3)
