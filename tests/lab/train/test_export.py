from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import torch
from torch.nn import functional

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.lab.train.export import export_onnx
from agribot.lab.train.features import centred_rgb
from agribot.lab.train.losses import dice_loss, segmentation_loss
from agribot.lab.train.network import CropWeedNet, count_parameters
from agribot.lab.train.precision import quantise_to_int8
from tests.lab.train.drawn_images import drawn_image


def test_the_exported_file_answers_as_the_network_does(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = CropWeedNet().eval()
    path = tmp_path / "net.onnx"
    export_onnx(network, path, height_px=96, width_px=128)
    image_rgb, _ = drawn_image(np.random.default_rng(0))
    class_map = Segmenter(path).segment(image_rgb)
    with torch.inference_mode():
        x = centred_rgb(torch.from_numpy(image_rgb).permute(2, 0, 1)[None])
        logits = functional.interpolate(
            network(x), scale_factor=2.0, mode="bilinear", align_corners=False
        )
        best = logits.softmax(dim=1).amax(dim=1)[0].numpy()
    assert (class_map.class_id == logits.argmax(dim=1)[0].numpy()).mean() > 0.999
    np.testing.assert_allclose(class_map.confidence / 255.0, best, atol=0.01)


def test_eight_bits_change_the_network_but_not_how_probabilities_are_told(tmp_path: Path) -> None:
    torch.manual_seed(0)
    image_rgb = np.random.default_rng(0).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    export_onnx(CropWeedNet().eval(), tmp_path / "whole.onnx", 96, 128)
    quantise_to_int8(tmp_path / "whole.onnx", tmp_path / "small.onnx", [image_rgb])
    whole = Segmenter(tmp_path / "whole.onnx").segment(image_rgb)
    small = Segmenter(tmp_path / "small.onnx").segment(image_rgb)
    assert small.confidence.min() >= 85  # a third of 255: the least that a winner can have
    assert np.abs(small.confidence.astype(int) - whole.confidence).mean() < 5.0
    network = onnx.load(str(tmp_path / "small.onnx")).graph.node
    quantised = {node.input[0] for node in network if node.op_type == "QuantizeLinear"}
    assert len(quantised) > 10
    around = {name for name in quantised if name.startswith("/") and "/network/" not in name}
    assert len(around) == 1, around  # what goes in


def test_the_network_is_small_enough_to_ship() -> None:
    assert 300_000 < count_parameters(CropWeedNet()) < 1_200_000


def test_a_perfect_answer_costs_nothing_and_a_wrong_one_much() -> None:
    target = torch.randint(0, 3, (2, 8, 8), generator=torch.Generator().manual_seed(0))
    right = 30.0 * functional.one_hot(target, 3).permute(0, 3, 1, 2).float()
    assert dice_loss(right, target) < 0.02
    assert dice_loss(right.roll(1, dims=1), target) > 0.9


def test_ignored_pixels_do_not_change_the_loss() -> None:
    torch.manual_seed(0)
    logits = torch.randn(1, 3, 4, 4)
    target = torch.randint(0, 3, (1, 8, 8))
    target[:, :, 4:] = 255
    other = logits.clone()
    other[:, :, :, 3:] += 5.0
    assert torch.isclose(
        segmentation_loss(logits, target), segmentation_loss(other, target), atol=1e-5
    )
