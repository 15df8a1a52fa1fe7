"""The weights trained on photographs: apart from the others, with scores that are not their own."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import msgspec
import pytest

from agribot.autonomy.perceive.pictures import classify
from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.core.config import load
from agribot.lab.train.card import ModelCard
from agribot.lab.train.evaluate import evaluate
from agribot.lab.train.photographs import find_pairs, read_pairs, split_fold
from tests import nightly

MODELS = {"cwfid": ("agribot-m", "int8"), "cwfid-s": ("agribot-s", "int8")}
DATA = Path(os.environ.get("AGRIBOT_DATA", "")) / "cwfid-train"


@pytest.fixture(scope="module", params=MODELS)
def card(request: pytest.FixtureRequest) -> ModelCard:
    card = read_card(request.param)
    assert card.name == request.param
    return card


def read_card(name: str) -> ModelCard:
    data = model_path(name).with_suffix(".json").read_bytes()
    return msgspec.json.decode(data, type=ModelCard)


def test_the_card_describes_the_file_and_its_condition(card: ModelCard) -> None:
    data = model_path(card.name).read_bytes()
    assert card.sha256 == hashlib.sha256(data).hexdigest()
    assert card.file_bytes == len(data) <= 8_000_000
    assert (card.plan.model, card.precision) == MODELS[card.name]
    assert "non-commercial" in card.license
    text = model_path(card.name).with_suffix(".md").read_text(encoding="utf-8")
    assert text == card.markdown()
    assert card.license in text
    assert "or for choosing a setting" not in text
    assert "ImageNet" in text


def test_the_card_says_what_its_command_does_otherwise_today(card: ModelCard) -> None:
    text = model_path(card.name).with_suffix(".md").read_text(encoding="utf-8")
    (line,) = (line for line in text.splitlines() if line.startswith("- Changed since: "))
    assert "albumentations" in line and "OpenCV" in line


@pytest.mark.parametrize("profile", ["farm", "beet"])
def test_no_mission_uses_it_unless_it_is_told_to(profile: str) -> None:
    assert load(profile).perception.model not in MODELS


def test_the_scores_stated_are_those_of_another_training_with_pictures_held_out(
    card: ModelCard,
) -> None:
    assert card.test == {}
    assert card.train_images == 39
    assert card.held_out is not None
    ((name, scores),) = card.held_out.test.items()
    assert (name, scores.images, card.held_out.train_images) == ("fold 0 of 5", 8, 31)
    assert "--fold" not in card.command
    assert "--fold 0" in card.held_out.command


@pytest.mark.slow
@nightly.one_by_one("name", ("cwfid-s", "cwfid"), in_suite=1)
@pytest.mark.skipif(not DATA.is_dir(), reason="the photographs are not here")
def test_pictures_that_it_was_trained_on_score_above_those_held_out(name: str) -> None:
    card = read_card(name)
    assert card.held_out is not None
    segmenter = Segmenter(card.name)
    pairs = split_fold(find_pairs(DATA, "cwfid")[0], 5, 0)[1]
    found = evaluate(
        lambda image_rgb: classify(segmenter, image_rgb).class_id,
        read_pairs(pairs, pytest.fail),
    )
    assert found.images == 8
    assert found.miou > card.held_out.test["fold 0 of 5"].miou + 0.02
