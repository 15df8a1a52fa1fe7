"""The network trained on a robot's photographs: what its card says, and what it names rightly."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import msgspec
import pytest

from agribot.autonomy.perceive.pictures import classify
from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.core.config import DEFAULT_MODEL, load
from agribot.lab.dataset.pictures import read_picture
from agribot.lab.rows.labelled import (
    RowPhoto,
    find_regions,
    fit_classes,
    fit_picture,
    read_lines,
)
from agribot.lab.rows.scores import NameScores
from agribot.lab.train.card import ModelCard
from agribot.lab.train.photographs import find_pairs, split_fold
from tests import nightly

MODEL = "agribot-field"
DATA = Path(os.environ.get("AGRIBOT_DATA", "")) / "crdld-rows"
EVERY = 6  # of the pictures kept aside


@pytest.fixture(scope="module")
def card() -> ModelCard:
    data = model_path(MODEL).with_suffix(".json").read_bytes()
    return msgspec.json.decode(data, type=ModelCard)


def test_the_card_describes_the_file_its_condition_and_what_it_saw(card: ModelCard) -> None:
    data = model_path(MODEL).read_bytes()
    assert card.sha256 == hashlib.sha256(data).hexdigest()
    assert card.file_bytes == len(data) <= 5_000_000
    text = model_path(MODEL).with_suffix(".md").read_text(encoding="utf-8")
    assert text == card.markdown()
    for words in ("non-commercial", "CRDLD 2", "CWFID", "Lameski", "simulator", "never shown"):
        assert words in text
    assert "No test image was used for training" in text


def test_the_card_has_figures_of_rows_kept_aside_and_of_single_plants(card: ModelCard) -> None:
    assert card.rows is not None and card.rows.pictures == 60
    assert {"beet-7-9", "all"} <= card.plants.keys()


def test_it_is_used_only_where_it_is_asked_for() -> None:
    assert MODEL not in {DEFAULT_MODEL, *(load(name).perception.model for name in ("farm", "beet"))}


@nightly.by_day("test_the_card_has_figures_of_rows_kept_aside_and_of_single_plants")
@pytest.mark.skipif(not DATA.is_dir(), reason="the photographs are not here")
def test_on_rows_kept_aside_it_names_plants_better_than_the_default() -> None:
    pairs = split_fold(find_pairs(DATA, "rows")[0], 5, 0)[1][::EVERY]
    balanced = {}
    for name in (MODEL, DEFAULT_MODEL):
        segmenter, scores = Segmenter(name), NameScores()
        for pair in pairs:
            image_rgb = read_picture(pair.image)
            picture = RowPhoto(fit_picture(image_rgb), read_lines(pair.mask, image_rgb.shape))
            classes = fit_classes(classify(segmenter, image_rgb))
            scores.add(find_regions(picture), classes.class_id)
        balanced[name] = scores.balanced or 0.0
    assert balanced[MODEL] > balanced[DEFAULT_MODEL] + 0.1
