"""What a card says of weights that no picture is left to judge."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from agribot.autonomy.perceive.segmenter import model_path
from agribot.core.errors import ConfigError
from agribot.lab.train.card import ModelCard, read_held_out

FOLD = "fold 0 of 5"


@pytest.fixture(scope="module")
def judged() -> ModelCard:
    """A card of a training that held a fold out."""
    data = model_path("cwfid-s").with_suffix(".json").read_bytes()
    card = msgspec.json.decode(data, type=ModelCard)
    test = card.test if card.held_out is None else card.held_out.test
    plan = msgspec.structs.replace(card.plan, steps=300, data="cwfid --folds 5 --fold 0")
    return msgspec.structs.replace(
        card, held_out=None, test=test, plan=plan, train_images=31, command="agribot train FOLD"
    )


def written(card: ModelCard, folder: Path) -> Path:
    path = folder / "fold.onnx"
    card.write(path)
    return path.with_suffix(".json")


def test_scores_of_the_same_recipe_are_stated_as_those_of_another_training(
    judged: ModelCard, tmp_path: Path
) -> None:
    plan = msgspec.structs.replace(judged.plan, steps=7000, data="cwfid")
    held_out = read_held_out(written(judged, tmp_path), plan)
    text = msgspec.structs.replace(
        judged, plan=plan, train_images=39, test={}, held_out=held_out
    ).markdown()
    assert "trained on all 39 images" in text
    assert "of another training by the same recipe, on 31 of the images for 300 steps" in text
    assert "`agribot train FOLD`" in text
    assert f"## {FOLD}: 8 images, mean IoU {judged.test[FOLD].miou:.3f}" in text
    assert "No test image was used" not in text


def test_another_recipe_lends_no_scores(judged: ModelCard, tmp_path: Path) -> None:
    path = written(judged, tmp_path)
    for change in ({"learning_rate": 0.1}, {"model": "agribot-m"}, {"data": "bonn"}):
        with pytest.raises(ConfigError, match="another recipe"):
            read_held_out(path, msgspec.structs.replace(judged.plan, **change))


def test_a_card_without_held_out_pictures_lends_no_scores(
    judged: ModelCard, tmp_path: Path
) -> None:
    bare = msgspec.structs.replace(judged, test={})
    assert "No scores were measured." in bare.markdown()
    with pytest.raises(ConfigError, match="held no images out"):
        read_held_out(written(bare, tmp_path), judged.plan)
    with pytest.raises(ConfigError, match=r"not the \.json of a model card"):
        read_held_out(tmp_path / "nothing.json", judged.plan)
