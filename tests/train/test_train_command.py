from __future__ import annotations

import argparse
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.errors import ConfigError
from agribot.perceive.segmenter import Segmenter
from agribot.train.card import ModelCard
from agribot.train.main import add_arguments, run


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return parser.parse_args(words)


@pytest.mark.slow
def test_one_command_goes_from_nothing_to_weights_with_a_card(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--images", "4", "--test-images", "2", "--steps", "2", "--out", str(tmp_path))
    assert run(parsed(*words)) == 0
    weights = tmp_path / "agribot-sim.onnx"
    card = msgspec.json.decode(weights.with_suffix(".json").read_bytes(), type=ModelCard)
    assert (card.plan.steps, card.train_images) == (2, 4)
    assert set(card.test) == {"random-fields", "farm"}
    assert np.array(card.test["farm"].confusion).sum() > 100_000
    image_rgb = np.zeros((480, 640, 3), dtype=np.uint8)
    assert Segmenter(weights).segment(image_rgb).class_id.shape == (480, 640)
    capsys.readouterr()
    assert run(parsed(*words)) == 0
    assert "going on from step 2" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [("--images", "0"), ("--steps", "0"), ("--minutes", "0"), ("--threads", "0")],
)
def test_an_option_out_of_range_names_itself(words: tuple[str, str], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=words[0]):
        run(parsed(*words, "--out", str(tmp_path)))
