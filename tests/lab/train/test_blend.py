from __future__ import annotations

from pathlib import Path

import pytest
import torch

from agribot.autonomy.perceive.segmenter import model_path
from agribot.cli.data.train_options import check_recipe_options
from agribot.core.errors import ConfigError
from agribot.lab.train.blend import blend_weights
from agribot.lab.train.export import export_onnx
from agribot.lab.train.network import CropWeedNet
from agribot.lab.train.start import read_convolutions
from tests import nightly
from tests.lab.train.changed_norms import change_norms
from tests.lab.train.command_line import parsed


def make_network(seed: int) -> CropWeedNet:
    """Make a narrow one, which is exported soon."""
    torch.manual_seed(seed)
    network = change_norms(CropWeedNet((4,) * 5, (1,) * 4, (4,) * 4))
    assert isinstance(network, CropWeedNet)
    return network.eval()


def answer(network: torch.nn.Module, x: torch.Tensor) -> torch.Tensor:
    with torch.inference_mode():
        answered: torch.Tensor = network(x)
    return answered


def test_at_either_end_of_a_blend_is_one_of_the_two_networks(tmp_path: Path) -> None:
    begun, learned, start = make_network(1), make_network(2), tmp_path / "start.onnx"
    export_onnx(begun, start)
    x = torch.randn(4, 3, 64, 96)
    for share, expected in ((1.0, learned), (1e-9, begun)):
        blended = blend_weights(learned, start, share, x)
        assert torch.allclose(answer(blended, x), answer(expected, x), rtol=1e-3, atol=1e-3)


@nightly.by_day(
    "test_at_either_end_of_a_blend_is_one_of_the_two_networks",
)
def test_half_way_every_weight_is_the_mean_of_both(tmp_path: Path) -> None:
    networks, files = [make_network(seed) for seed in (1, 2)], []
    for index, network in enumerate(networks):
        files.append(tmp_path / f"{index}.onnx")
        export_onnx(network, files[-1])
    blended = blend_weights(networks[1], files[0], 0.5, torch.randn(4, 3, 64, 96))
    export_onnx(blended, tmp_path / "blended.onnx")
    parts = [read_convolutions(path) for path in (*files, tmp_path / "blended.onnx")]
    for (begun, _), (learned, _), (half, _) in zip(*parts, strict=True):
        assert torch.allclose(half, (begun + learned) / 2.0, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    "words",
    [
        ("--blend", "0.5"),
        ("--blend", "0"),
        ("--blend", "1.5", "--start", "agribot-sim"),
        ("--blend-with", "agribot-sim"),
    ],
)
def test_a_blend_needs_a_start_and_a_share(words: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--blend"):
        check_recipe_options(parsed("--model", "agribot-sim", *words, "--out", str(tmp_path)))


def test_a_blend_may_begin_at_weights_that_the_training_did_not(tmp_path: Path) -> None:
    words = ("--start", "agribot-sim", "--blend", "0.8", "--blend-with", "agribot-sim")
    args = parsed("--model", "agribot-sim", *words, "--out", str(tmp_path))
    check_recipe_options(args)
    assert args.blend_with == model_path("agribot-sim")
    assert "--blend 0.8 --blend-with agribot-sim " in args.recipe_words
