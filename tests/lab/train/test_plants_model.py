"""The packaged network that finds single plants, on fields that no training has seen."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.core.config import load
from agribot.lab.bench.plant_scenes import SCENES
from agribot.lab.bench.plants import judge_scenes
from agribot.lab.train.card import ModelCard
from agribot.lab.train.simulated import draw_random_field

MODEL = "agribot-plants"
FRESH_STREAM = 78  # no training draws from it
SEED = 5  # not that of the tables


def judge(*names: str) -> dict[str, Any]:
    scenes = [SCENES[name] for name in names]
    return judge_scenes(scenes, MODEL, preset="kind", frames=4, seed=SEED)


def test_the_card_tells_of_single_plants_scene_by_scene() -> None:
    data = model_path(MODEL).with_suffix(".json").read_bytes()
    card = msgspec.json.decode(data, type=ModelCard)
    assert card.plants.keys() == {*SCENES, "all"}


def test_its_classes_are_those_of_the_default_network() -> None:
    one, other = Segmenter("agribot-sim"), Segmenter(MODEL)
    assert other.finds_plants and not one.finds_plants
    for image_rgb, *_ in draw_random_field(np.random.default_rng([0, FRESH_STREAM]), 2):
        expected, found = one.segment(image_rgb), other.segment(image_rgb)
        assert (found.class_id == expected.class_id).mean() > 0.9995
        assert np.abs(found.confidence.astype(int) - expected.confidence).max() <= 5


def test_missions_in_rows_that_touch_use_it() -> None:
    assert load("beet").perception.model == MODEL
    assert load("farm").perception.model == "agribot-sim"


@pytest.mark.parametrize("name", ["beet-7-9", "beet-10-12"])
def test_beets_whose_leaves_touch_are_single_plants(name: str) -> None:
    found = judge(name)
    assert found["crops_truth"] > 80
    assert found["crop_recall"] > 0.75 and found["crop_precision"] > 0.75
    assert found["stem_error_median_m"] < 0.02
    assert found["crops_hit"] <= 0.01 * found["crops_truth"]


def test_other_crops_are_found_plant_by_plant_too() -> None:
    found = judge("lettuce", "maize", "onion")
    assert min(scene["crop_recall"] for scene in found["by"]) > 0.7


def test_most_weeds_of_a_carpet_are_found() -> None:
    found = judge("weeds-20")
    assert found["weeds_truth"] > 80
    assert found["weed_recall"] > 0.5 and found["weed_precision"] > 0.7
