from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.core.messages import PlantClass
from agribot.lab.train.figures import tint, write_curves, write_figures
from agribot.lab.train.network_scores import NetworkScores, format_scores


def judged(images: int, wrong_ratio: float) -> NetworkScores:
    """A network that says 80 % everywhere and is wrong in a known share of the pixels."""
    network_scores = NetworkScores(keep_worst=2)
    rng = np.random.default_rng(0)
    for index in range(images):
        truth = rng.integers(0, 3, (60, 80), dtype=np.uint8)
        wrong = rng.random(truth.shape) < wrong_ratio * (index + 1) * 2 / (images + 1)
        guess = np.where(wrong, (truth + 1) % 3, truth).astype(np.uint8)
        sure = np.full(truth.shape, 204, np.uint8)
        image_rgb = np.zeros((60, 80, 3), np.uint8)
        network_scores.add(f"{index}.png", image_rgb, truth, PictureClasses(guess, sure))
    return network_scores


def test_reliability_compares_confidence_with_the_share_that_is_right() -> None:
    honest, boastful = judged(4, 0.2).reliability, judged(4, 0.5).reliability
    assert sum(honest.pixels) == 4 * 60 * 80
    assert honest.calibration_error < 0.02
    assert boastful.calibration_error == pytest.approx(0.3, abs=0.02)
    (accuracy,) = [value for value in boastful.accuracy if value is not None]
    assert accuracy == pytest.approx(0.5, abs=0.02)


def test_sure_soil_does_not_hide_doubtful_plants() -> None:
    network_scores = NetworkScores()
    truth = np.full((10, 10), PlantClass.SOIL, np.uint8)
    truth[0] = PlantClass.CROP
    guess = truth.copy()
    guess[0, :5] = PlantClass.WEED
    found = PictureClasses(guess, np.full((10, 10), 255, np.uint8))
    network_scores.add("field", np.zeros((10, 10, 3), np.uint8), truth, found)
    reliability = network_scores.reliability
    assert reliability.calibration_error == pytest.approx(0.05)
    assert reliability.plant_error == pytest.approx(0.5)


def test_pixels_that_do_not_count_are_not_judged() -> None:
    network_scores = NetworkScores()
    truth = np.full((10, 10), 255, np.uint8)
    truth[:5] = PlantClass.CROP
    found = PictureClasses(
        np.full((10, 10), PlantClass.CROP, np.uint8), np.full((10, 10), 255, np.uint8)
    )
    network_scores.add("half", np.zeros((10, 10, 3), np.uint8), truth, found)
    assert network_scores.confusion.sum() == 50
    assert sum(network_scores.reliability.pixels) == 50
    assert network_scores.scores.iou["weed"] is None


def test_the_pooled_scores_are_not_the_mean_of_the_images() -> None:
    network_scores = judged(5, 0.3)
    pooled = network_scores.scores
    hits = np.diag(network_scores.confusion)
    union = network_scores.confusion.sum(axis=0) + network_scores.confusion.sum(axis=1) - hits
    assert pooled.miou == pytest.approx(float(np.mean(hits / union)))
    assert pooled.images == 5


def test_a_surer_threshold_gives_up_recall() -> None:
    network_scores = judged(3, 0.3)
    precision, recall = network_scores.precision_recall(PlantClass.CROP)
    assert (np.diff(recall) >= 0.0).all()
    assert recall[-1] == 1.0
    # At the network's own choice the curve passes through the scores of the class map.
    scores = network_scores.scores
    assert scores.recall["crop"] is not None
    near = int(np.argmin(np.abs(recall - scores.recall["crop"])))
    assert precision[near] == pytest.approx(scores.precision["crop"], abs=1e-9)
    assert precision[-1] == pytest.approx(1 / 3, abs=0.02)


def test_the_sheet_keeps_the_worst_images() -> None:
    assert [one.name for one in judged(5, 0.3).worst] == ["4.png", "3.png"]


def test_the_table_names_classes_and_images() -> None:
    text = format_scores(judged(2, 0.1).scores)
    for word in ("weed", "crop", "soil", "2 images"):
        assert word in text


def test_figures_are_pictures_with_something_on_them(tmp_path: Path) -> None:
    for path in write_figures(judged(3, 0.3), tmp_path):
        with Image.open(path) as figure:
            pixels = np.asarray(figure.convert("L"))
        assert min(pixels.shape) > 200
        assert (pixels < 128).mean() > 0.002


def test_curves_are_drawn_from_a_training_log(tmp_path: Path) -> None:
    log = tmp_path / "training.csv"
    rows = "\n".join(f"{i},0.001,{2.0 / i},1.0" for i in range(1, 80))
    log.write_text("step,learning_rate,loss,cpu_s\n" + rows + "\n", encoding="utf-8")
    with Image.open(write_curves(log, tmp_path / "curves.png")) as figure:
        assert figure.size[0] > 300


def test_an_overlay_colours_plants_and_leaves_the_soil() -> None:
    image_rgb = np.full((1, 3, 3), 100, np.uint8)
    weed, crop, soil = tint(image_rgb, np.array([[0, 1, 2]], np.uint8))[0].astype(int)
    assert weed[0] > weed[1] + 50
    assert crop[1] > crop[0] + 50
    assert soil.tolist() == [100, 100, 100]
