from __future__ import annotations

import numpy as np
import pytest

from agribot.lab.dataset.pictures import resize_nearest
from agribot.lab.train.evaluate import compute_scores, count_confusion, evaluate


def test_every_pixel_is_counted_by_truth_and_guess() -> None:
    truth = np.array([[0, 0, 1], [1, 2, 2]], dtype=np.uint8)
    guess = np.array([[0, 1, 1], [1, 2, 0]], dtype=np.uint8)
    assert count_confusion(truth, guess).tolist() == [[1, 1, 0], [0, 2, 0], [1, 0, 1]]


def test_pixels_without_a_true_class_do_not_count() -> None:
    truth = np.array([255, 255, 1], dtype=np.uint8)
    assert count_confusion(truth, np.array([0, 1, 1], dtype=np.uint8)).sum() == 1


def test_scores_follow_from_the_confusion_by_hand() -> None:
    result = compute_scores(np.array([[60, 20, 20], [10, 80, 10], [0, 0, 800]]), images=1)
    assert result.iou["weed"] == pytest.approx(60 / 110)
    assert result.precision["weed"] == pytest.approx(60 / 70)
    assert result.recall["weed"] == pytest.approx(60 / 100)
    assert result.iou["crop"] == pytest.approx(80 / 120)
    assert result.iou["soil"] == pytest.approx(800 / 830)
    assert result.miou == pytest.approx((60 / 110 + 80 / 120 + 800 / 830) / 3)
    p, r = result.precision["crop"], result.recall["crop"]
    assert p and r
    assert result.f1["crop"] == pytest.approx(2 * p * r / (p + r))


def test_a_class_that_never_occurs_is_left_out_of_the_mean() -> None:
    result = compute_scores(np.array([[0, 0, 0], [0, 50, 0], [0, 0, 50]]), images=1)
    assert result.iou["weed"] is None
    assert result.miou == 1.0


def test_pixels_are_pooled_over_images_and_not_averaged_per_image() -> None:
    small = (np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1), np.uint8))
    large = (np.zeros((10, 10, 3), np.uint8), np.full((10, 10), 2, np.uint8))
    result = evaluate(lambda image: np.full(image.shape[:2], 2, np.uint8), [small, large])
    assert result.images == 2
    assert result.iou["soil"] == pytest.approx(100 / 101)
    assert result.iou["weed"] == 0.0


def test_a_coarse_answer_is_judged_at_the_resolution_of_the_truth() -> None:
    coarse = np.array([[0, 1], [2, 1]], dtype=np.uint8)
    fine = resize_nearest(coarse, (4, 6))
    assert np.array_equal(fine, np.kron(coarse, np.ones((2, 3), np.uint8)))
