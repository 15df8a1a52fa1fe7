from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.lab.train.calibration import calibrate, calibration_error, fit_temperature
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.export import DeployedNet, export_onnx
from agribot.lab.train.network import CropWeedNet
from tests.lab.train.drawn_images import drawn_image

BOASTFUL = 2.5


def boastful(pixels: int, seed: int) -> tuple[Tensor, Tensor]:
    """Logits of a network that is 2.5 times too sure, and classes drawn from what is true."""
    generator = torch.Generator().manual_seed(seed)
    honest = 1.5 * torch.randn(pixels, 3, generator=generator)
    truth = torch.multinomial(honest.softmax(dim=1), 1, generator=generator)[:, 0]
    return BOASTFUL * honest, truth


def test_the_temperature_of_a_network_that_is_too_sure_is_found() -> None:
    assert fit_temperature(*boastful(40_000, seed=0)) == pytest.approx(BOASTFUL, rel=0.04)


def test_a_temperature_makes_confidence_the_share_that_is_right() -> None:
    logits, truth = boastful(40_000, seed=1)
    assert calibration_error(logits, truth) > 0.1
    assert calibration_error(logits / BOASTFUL, truth) < 0.015


def test_a_network_is_calibrated_on_images_set_aside_and_judged_on_others() -> None:
    def guesses(image: Tensor) -> Tensor:
        """Greener is crop, redder is weed: always far too sure."""
        red, green, blue = image[0].permute(2, 0, 1).float()
        return torch.stack([red - green, green - red, blue])[None]

    def images(first: int) -> Iterator[LabelledImage]:
        return (drawn_image(np.random.default_rng(seed)) for seed in range(first, first + 3))

    found = calibrate(guesses, images(0), images(10))
    assert found.images == 3
    assert found.temperature > 1.0
    assert found.error_after < found.error_before


def test_pixels_that_do_not_count_do_not_change_the_temperature() -> None:
    def guesses(image: Tensor) -> Tensor:
        return image[0].permute(2, 0, 1).float()[None] / 20.0

    image_rgb, label = drawn_image(np.random.default_rng(0))
    label = label.copy()
    label[: len(label) // 2] = 255
    other = image_rgb.copy()
    other[: len(label) // 2] = 255 - other[: len(label) // 2]
    tests = [drawn_image(np.random.default_rng(1))]
    assert calibrate(guesses, [(image_rgb, label)], tests) == calibrate(
        guesses, [(other, label)], tests
    )


def test_a_temperature_in_the_graph_changes_how_sure_it_is_but_no_class(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = CropWeedNet().eval()
    image_rgb, _ = drawn_image(np.random.default_rng(0))
    answers = []
    for temperature in (1.0, 4.0):
        path = tmp_path / f"{temperature}.onnx"
        export_onnx(network, path, 96, 128, temperature=temperature)
        answers.append(Segmenter(path).segment(image_rgb))
    with torch.inference_mode():
        logits = DeployedNet(network, 96, 128).logits(torch.from_numpy(image_rgb)[None])
    expected = (logits / 4.0).softmax(dim=1).amax(dim=1)[0].numpy()
    np.testing.assert_allclose(answers[1].confidence / 255.0, expected, atol=0.01)
    assert np.array_equal(answers[0].class_id, answers[1].class_id)
    assert (answers[1].confidence <= answers[0].confidence).all()
