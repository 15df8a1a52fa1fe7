"""The network for plants close from above, which has seen no photograph, on photographs."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.autonomy.perceive.pictures import classify
from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.lab.train.card import ModelCard
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.evaluate import evaluate
from agribot.lab.train.photographs import find_pairs, read_pairs
from agribot.lab.train.simulated import draw_seedlings

MODEL = Path(__file__).parents[3] / "examples" / "networks" / "agribot-seedlings.onnx"
DEFAULT = "agribot-plants"
DATA = Path(os.environ.get("AGRIBOT_DATA", "")) / "carrot-weed"
FRESH_STREAM = 79  # no training draws from it


def test_the_card_describes_the_file_and_no_photograph() -> None:
    card = msgspec.json.decode(MODEL.with_suffix(".json").read_bytes(), type=ModelCard)
    data = MODEL.read_bytes()
    assert card.name == MODEL.stem
    assert card.sha256 == hashlib.sha256(data).hexdigest()
    assert card.file_bytes == len(data) <= 4_000_000
    assert card.license == "Apache-2.0"
    assert "no photograph was used" in card.data
    assert MODEL.with_suffix(".md").read_text(encoding="utf-8") == card.markdown()


def test_it_tells_seedlings_from_weeds_better_than_the_default_network() -> None:
    def draw_views() -> Iterator[LabelledImage]:
        for scene in range(12):
            rng = np.random.default_rng([0, FRESH_STREAM, scene])
            for image_rgb, label, _ in draw_seedlings(rng, 1):
                yield image_rgb, label

    views = list(draw_views())

    def judge(model: Path | str) -> float:
        segmenter = Segmenter(model)
        return evaluate(lambda image_rgb: segmenter.segment(image_rgb).class_id, views).miou

    assert judge(MODEL) > max(0.8, judge(DEFAULT) + 0.02)


@pytest.mark.skipif(not DATA.is_dir(), reason="AGRIBOT_DATA holds no carrot-weed")
def test_it_knows_carrots_on_photographs_that_it_has_never_seen() -> None:
    pairs, problems = find_pairs(DATA, "folder")
    assert not problems
    segmenter = Segmenter(MODEL)
    scores = evaluate(
        lambda image_rgb: classify(segmenter, image_rgb).class_id, read_pairs(pairs, pytest.fail)
    )
    assert scores.images == 15
    assert scores.miou > 0.7
