"""Weights of the classes, from the labels of the pictures that a training has."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.cli.data.train import run
from agribot.core.errors import ConfigError
from agribot.lab.train.card import ModelCard, read_held_out
from agribot.lab.train.class_weights import compute_weights, count_classes
from tests.lab.train.command_line import parsed
from tests.lab.train.photo_folder import photo_folder

# Picture one: 10 weed, 30 crop, 60 soil. Picture two: 20 crop, 80 soil, and 5 that do not count.
LABELS = [
    np.repeat(np.array([0, 1, 2], np.uint8), (10, 30, 60)).reshape(10, 10),
    np.repeat(np.array([1, 2, 255], np.uint8), (20, 80, 5)).reshape(15, 7),
]


def test_pixels_are_counted_over_all_and_over_the_pictures_that_have_the_class() -> None:
    counts = count_classes(LABELS)
    assert counts.pixels.tolist() == [10, 50, 140]
    assert counts.beside.tolist() == [100, 200, 200]
    assert counts.ratios.tolist() == [0.05, 0.25, 0.7]


def test_median_frequency_divides_the_median_share_by_that_of_the_class() -> None:
    # Shares 0.1, 0.25 and 0.7 of the pictures with the class.
    assert compute_weights(count_classes(LABELS), "median-frequency") == (2.5, 1.0, 0.3571)


def test_weights_of_the_inverse_share_have_a_mean_of_one() -> None:
    counts = count_classes(LABELS)
    inverse = np.array(compute_weights(counts, "inverse-frequency"))
    root = np.array(compute_weights(counts, "inverse-root"))
    assert inverse * counts.ratios == pytest.approx(np.full(3, inverse[0] * 0.05), rel=1e-3)
    assert root**2 * counts.ratios == pytest.approx(np.full(3, root[0] ** 2 * 0.05), rel=1e-3)
    assert inverse.mean() == pytest.approx(1.0, abs=1e-3)
    assert root.mean() == pytest.approx(1.0, abs=1e-3)
    assert compute_weights(counts, "auto") == tuple(root)


def test_a_class_that_no_pixel_has_is_named() -> None:
    with pytest.raises(ConfigError, match=r"no pixel .* is weed; give numbers, such as 1,2,0\.6"):
        compute_weights(count_classes(LABELS[1:]), "auto")


def test_computed_weights_are_printed_and_stand_in_plan_card_and_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos = photo_folder(tmp_path / "photos", 3)
    words = [
        *("--data", "folder", "--data-dir", str(photos), "--model", "agribot-sim"),
        *("--loss", "dice-generalised", "--size", "64x64", "--steps", "1"),
        *("--class-weights", "median-frequency"),
    ]
    folds = ("--folds", "3", "--fold", "0")
    assert run(parsed(*words, *folds, "--out", str(tmp_path / "out"))) == 0
    path = tmp_path / "out" / "agribot-sim.json"
    card = msgspec.json.decode(path.read_bytes(), type=ModelCard)
    assert card.plan.overlap_loss == "dice-generalised"
    assert card.plan.class_weighting.startswith("class weights, median-frequency: weed ")
    assert f"crop {card.plan.class_weights[1]:g} (of " in card.plan.class_weighting
    assert f"{card.plan.class_weighting}\n" in capsys.readouterr().err
    assert f"- C{card.plan.class_weighting[1:]}\n" in card.markdown()
    assert "--class-weights median-frequency " in card.command
    # All pictures have other shares than those without a fold; the recipe is the same.
    other = msgspec.structs.replace(card.plan, class_weights=(1.0, 1.0, 1.0), class_weighting="x")
    assert read_held_out(path, other).steps == 1
