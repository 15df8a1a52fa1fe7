"""The packaged network that finds single plants, on fields that no training has seen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.core.config import load
from agribot.lab.bench.plant_scenes import SCENES
from agribot.lab.bench.plants import judge_scenes
from agribot.lab.train.card import ModelCard
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.evaluate import evaluate
from agribot.lab.train.farm import draw_row_crop
from agribot.sim.random_scenes import DENSE

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


@pytest.mark.parametrize("species", [crop for crop, *_ in DENSE.crops])
def test_it_tells_each_of_the_five_crops_from_weeds(species: str) -> None:
    segmenter = Segmenter(MODEL)
    one_crop = DENSE._replace(
        crops=tuple(crop for crop in DENSE.crops if crop[0] == species), crop_share=(1.0,)
    )

    def draw_views() -> Iterator[LabelledImage]:
        for scene in range(6):
            rng = np.random.default_rng([0, FRESH_STREAM, scene])
            for image_rgb, label, _ in draw_row_crop(rng, 1, one_crop):
                yield image_rgb, label

    scores = evaluate(lambda image_rgb: segmenter.segment(image_rgb).class_id, draw_views())
    crop, weed = scores.iou["crop"], scores.iou["weed"]
    assert crop is not None and weed is not None
    assert crop > 0.7 and weed > 0.6


def test_missions_in_rows_that_touch_use_it() -> None:
    assert load("beet").perception.model == MODEL
    assert load("farm").perception.model == "agribot-sim"


@pytest.mark.parametrize("name", ["beet-7-9", "beet-10-12"])
def test_beets_whose_leaves_touch_are_single_plants(name: str) -> None:
    found = judge(name)
    assert found["crops_truth"] > 80
    assert found["crop_recall"] > 0.8 and found["crop_precision"] > 0.8
    assert found["stem_error_median_m"] < 0.02
    assert found["crops_hit"] <= 0.01 * found["crops_truth"]


def test_other_crops_are_found_plant_by_plant_too() -> None:
    found = judge("lettuce", "maize", "onion")
    assert min(scene["crop_recall"] for scene in found["by"]) > 0.7


def test_most_weeds_of_a_carpet_are_found() -> None:
    found = judge("weeds-20")
    assert found["weeds_truth"] > 80
    assert found["weed_recall"] > 0.6 and found["weed_precision"] > 0.7
