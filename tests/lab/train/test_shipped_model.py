from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.segmenter import Segmenter, model_path
from agribot.core.messages import PlantClass
from agribot.lab.train.card import ModelCard
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.evaluate import evaluate
from agribot.lab.train.simulated import draw_random_field
from tests import nightly
from tests.lab.train.farm_views import Found, look_at_farm

MODEL = "agribot-sim"
# No training draws from this stream of random numbers.
FRESH_STREAM = 77


def fresh_views(scenes: Sequence[int]) -> Iterator[LabelledImage]:
    for scene in scenes:
        rng = np.random.default_rng([0, FRESH_STREAM, scene])
        for image_rgb, label, _ in draw_random_field(rng, 1):
            yield image_rgb, label


@pytest.fixture(scope="module")
def farm() -> dict[PlantClass, Found]:
    return look_at_farm(MODEL, worlds=6, views=4)


@pytest.mark.parametrize(
    ("model", "most_bytes"), [(MODEL, 2_000_000), ("agribot-plants", 5_000_000)]
)
def test_the_card_describes_the_file_beside_it(model: str, most_bytes: int) -> None:
    path = model_path(model)
    card = msgspec.json.decode(path.with_suffix(".json").read_bytes(), type=ModelCard)
    assert card.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert card.license == "Apache-2.0"
    assert card.command.startswith("agribot train ")
    assert path.with_suffix(".md").read_text(encoding="utf-8") == card.markdown()
    assert path.stat().st_size < most_bytes


@nightly.all_or_first("scenes", range(24), in_suite=4, unit="scenes")
def test_crop_and_weed_are_told_apart_on_fields_never_seen(scenes: Sequence[int]) -> None:
    segmenter = Segmenter(MODEL)
    scores = evaluate(lambda image: segmenter.segment(image).class_id, fresh_views(scenes))
    for name, least in (("crop", 0.85), ("weed", 0.55), ("soil", 0.98)):
        iou = scores.iou[name]
        assert iou is not None and iou > least, name


@nightly.by_day(
    "test_crop_and_weed_are_told_apart_on_fields_never_seen",
    "tests/autonomy/perceive/test_plants.py::test_each_plant_is_found_once_with_its_class_and_area",
)
@pytest.mark.parametrize("kind", [PlantClass.WEED, PlantClass.CROP])
def test_single_frames_of_the_farm_show_nearly_every_plant(
    farm: dict[PlantClass, Found], kind: PlantClass
) -> None:
    assert farm[kind].true >= 15
    assert farm[kind].recall > 0.8


@nightly.by_day(
    "test_crop_and_weed_are_told_apart_on_fields_never_seen",
    "tests/autonomy/perceive/test_plants.py::test_each_plant_is_found_once_with_its_class_and_area",
)
@pytest.mark.parametrize("kind", [PlantClass.WEED, PlantClass.CROP])
def test_nearly_every_report_on_the_farm_is_a_plant_of_that_class(
    farm: dict[PlantClass, Found], kind: PlantClass
) -> None:
    assert farm[kind].precision > 0.85


@nightly.by_day(
    "test_crop_and_weed_are_told_apart_on_fields_never_seen",
    "tests/autonomy/perceive/test_plants.py::test_flat_and_tall_weeds_lie_within_three_sigma_of_their_place",
)
@pytest.mark.parametrize("kind", [PlantClass.WEED, PlantClass.CROP])
def test_plants_are_placed_to_a_few_centimetres_and_know_how_well(
    farm: dict[PlantClass, Found], kind: PlantClass
) -> None:
    assert np.median(farm[kind].error_m) < 0.035
    assert np.percentile(farm[kind].error_sigma, 90) < 3.5
