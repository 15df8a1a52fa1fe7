"""How sure a network of photographs is, is learned from photographs that taught it nothing."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from agribot.cli.data.train import run
from agribot.lab.train.calibration import AS_TRAINED
from agribot.lab.train.card import ModelCard
from agribot.lab.train.export import read_temperatures
from tests import nightly
from tests.lab.train.command_line import parsed
from tests.lab.train.photo_folder import photo_folder


def train(folder: Path, out: Path, *words: str) -> tuple[ModelCard, Path]:
    recipe = ("--model", "original-bonnet", "--size", "64x64", "--crop-px", "64", "--steps", "2")
    data = ("--data", "cwfid", "--data-dir", str(folder), "--out", str(out))
    assert run(parsed(*data, *recipe, *words)) == 0
    weights = out / "original-bonnet.onnx"
    card = msgspec.json.decode(weights.with_suffix(".json").read_bytes(), type=ModelCard)
    return card, weights


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return photo_folder(tmp_path_factory.mktemp("photos") / "set", 6)


@pytest.mark.slow
def test_a_fold_that_is_held_out_tells_it_to_the_training_on_all(
    photos: Path, tmp_path: Path
) -> None:
    held, weights = train(photos, tmp_path / "fold", "--folds", "3", "--fold", "1")
    found = held.calibration
    assert found is not None and found.is_by_turns and found.images == 2
    assert found.error_after is not None
    assert read_temperatures(weights) == found.temperatures != AS_TRAINED
    assert "each judged by the others" in held.markdown()

    scores = ("--scores-from", str(weights.with_suffix(".json")))
    card, of_all = train(photos, tmp_path / "all", *scores)
    assert card.calibration is None and card.train_images == 6
    assert card.held_out is not None and card.held_out.calibration == found
    assert read_temperatures(of_all) == found.temperatures
    assert "those of the training that held images out" in card.markdown()


@nightly.by_day(
    "test_a_fold_that_is_held_out_tells_it_to_the_training_on_all",
    "tests/lab/train/test_train_command.py::"
    "test_photographs_set_aside_draw_the_curve_and_teach_nothing",
)
@pytest.mark.slow
def test_photographs_set_aside_tell_it_and_a_fold_judges_it(photos: Path, tmp_path: Path) -> None:
    words = ("--validate", "2", "--folds", "3", "--fold", "0")
    card, weights = train(photos, tmp_path / "both", *words)
    found = card.calibration
    assert found is not None and not found.is_by_turns and found.images == 2
    assert card.train_images == 2
    assert read_temperatures(weights) == found.temperatures
    assert "expected calibration error on test images" in card.markdown()


@pytest.mark.slow
def test_where_every_photograph_teaches_confidence_stays_as_it_is(
    photos: Path, tmp_path: Path
) -> None:
    card, weights = train(photos, tmp_path / "all")
    assert card.calibration is None
    assert read_temperatures(weights) == AS_TRAINED
    assert "no image was set aside" in card.markdown()
