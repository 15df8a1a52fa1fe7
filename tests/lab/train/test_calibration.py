from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.messages import PlantClass
from agribot.lab.train.calibration import (
    MAX_TEMPERATURE,
    Calibration,
    Temperatures,
    calibrate,
    calibration_error,
    fit_temperature,
    fit_temperatures,
)
from agribot.lab.train.data import LabelledImage
from agribot.lab.train.export import DeployedNet, export_onnx, read_temperatures
from agribot.lab.train.network import CropWeedNet
from tests import nightly
from tests.lab.train.drawn_images import drawn_image

BOASTFUL = 2.5


def boastful(pixels: int, seed: int) -> tuple[Tensor, Tensor]:
    """Logits of a network that is 2.5 times too sure, and classes drawn from what is true."""
    generator = torch.Generator().manual_seed(seed)
    honest = 1.5 * torch.randn(pixels, 3, generator=generator)
    truth = torch.multinomial(honest.softmax(dim=1), 1, generator=generator)[:, 0]
    return BOASTFUL * honest, truth


def colour_guesses(image: Tensor) -> Tensor:
    """Greener is crop, redder is weed: always far too sure."""
    red, green, blue = image[0].permute(2, 0, 1).float()
    return torch.stack([red - green, green - red, blue])[None] / 10.0


def calibrated(aside: Iterable[LabelledImage], tests: Iterable[LabelledImage] = ()) -> Calibration:
    found = calibrate(colour_guesses, aside, tests)
    assert found is not None
    return found


def large_image(seed: int) -> LabelledImage:
    """Each pixel of a drawn image four times as wide and high."""
    image_rgb, label = drawn_image(np.random.default_rng(seed))
    return image_rgb.repeat(4, axis=0).repeat(4, axis=1), label.repeat(4, axis=0).repeat(4, axis=1)


def test_the_temperature_of_a_network_that_is_too_sure_is_found() -> None:
    assert fit_temperature(*boastful(40_000, seed=0)) == pytest.approx(BOASTFUL, rel=0.04)


def test_a_temperature_makes_confidence_the_share_that_is_right() -> None:
    logits, truth = boastful(40_000, seed=1)
    assert calibration_error(logits, truth) > 0.1
    assert calibration_error(logits / BOASTFUL, truth) < 0.015


@nightly.by_day(
    "test_each_class_has_the_temperature_of_the_pixels_called_so",
    "test_what_a_single_image_brings_is_not_measured",
)
def test_a_network_is_calibrated_on_images_set_aside_and_judged_on_others() -> None:
    def images(first: int) -> Iterator[LabelledImage]:
        return (large_image(seed) for seed in range(first, first + 3))

    found = calibrated(images(0), images(10))
    assert found.images == 3
    assert found.temperatures.weed > 1.0
    assert found.error_after is not None
    assert found.error_after < found.error_before
    assert not found.is_by_turns
    assert found == calibrated(images(0), images(10))
    assert found.error_before == calibrated(images(10)).error_before


def test_each_class_has_the_temperature_of_the_pixels_called_so() -> None:
    logits, truth = boastful(80_000, seed=2)
    called = logits.argmax(dim=1)
    logits[called == PlantClass.SOIL] /= BOASTFUL
    logits[called == PlantClass.CROP] *= 2.0
    found = fit_temperatures((logits, truth))
    assert found.weed == pytest.approx(BOASTFUL, rel=0.1)
    assert found.crop == pytest.approx(2.0 * BOASTFUL, rel=0.1)
    assert found.soil == pytest.approx(1.0, rel=0.1)
    surer = found.divide(logits)
    assert torch.equal(surer.argmax(dim=1), called)
    is_plant = called != PlantClass.SOIL
    assert calibration_error(surer[is_plant], truth[is_plant]) < 0.02
    assert calibration_error(logits[is_plant], truth[is_plant]) > 0.1


def test_without_other_images_each_is_judged_with_what_the_others_tell() -> None:
    one, other = large_image(0), large_image(1)
    twins = calibrated([one, one])
    assert twins.is_by_turns and twins.images == 2
    itself = calibrated([one], [one])
    assert twins.error_after == pytest.approx(itself.error_after)
    assert twins.plant_error_after == pytest.approx(itself.plant_error_after)
    mixed = calibrated([one, other])
    own = calibrated([one, other], [one, other])
    assert mixed.temperatures == own.temperatures
    assert mixed.error_before == own.error_before
    assert mixed.error_after != own.error_after, "with its own pictures"


def test_what_a_single_image_brings_is_not_measured() -> None:
    found = calibrated([large_image(0)])
    assert found.temperatures.weed > 1.0
    assert found.error_after is None and found.plant_error_after is None
    assert found.plant_error_before is not None


def test_where_no_image_can_be_read_nothing_is_found() -> None:
    assert calibrate(colour_guesses, [], [large_image(0)]) is None


def test_few_pixels_tell_no_temperature_and_faultless_ones_no_endless_one() -> None:
    logits, truth = boastful(60, seed=0)
    assert fit_temperature(logits, truth) == 1.0
    logits, _ = boastful(4_000, seed=0)
    assert fit_temperature(logits, logits.argmax(dim=1)) >= 1.0 / MAX_TEMPERATURE * (1.0 - 1e-6)


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


def call_half_of_it_plants(network: CropWeedNet, image_rgb: np.ndarray) -> None:
    """Shift the soil of a network that has learned nothing, so that it calls half an image soil."""
    with torch.no_grad():
        logits = DeployedNet(network, 96, 128).logits(torch.from_numpy(image_rgb)[None])[0]
        *_, last = (one for one in network.modules() if isinstance(one, torch.nn.Conv2d))
        assert last.bias is not None
        last.bias[PlantClass.SOIL] -= (logits[2] - logits[:2].amax(dim=0)).median()


@nightly.one_by_one(
    "temperatures",
    [Temperatures(weed=2.0, crop=4.0, soil=1.0), Temperatures(weed=4.0, crop=4.0, soil=4.0)],
    in_suite=1,
)
def test_temperatures_in_the_graph_change_how_sure_it_is_but_no_class(
    tmp_path: Path, temperatures: Temperatures
) -> None:
    torch.manual_seed(0)
    network = CropWeedNet().eval()
    image_rgb, _ = drawn_image(np.random.default_rng(0))
    call_half_of_it_plants(network, image_rgb)
    answers = []
    for name, each in (("as trained", Temperatures()), ("calibrated", temperatures)):
        path = tmp_path / f"{name}.onnx"
        export_onnx(network, path, 96, 128, temperatures=each)
        assert read_temperatures(path) == each
        answers.append(Segmenter(path).segment(image_rgb))
    with torch.inference_mode():
        logits = DeployedNet(network, 96, 128).logits(torch.from_numpy(image_rgb)[None])
    pixels = logits[0].permute(1, 2, 0).reshape(-1, 3)
    expected = temperatures.divide(pixels).softmax(dim=1).amax(dim=1).reshape(logits.shape[2:])
    np.testing.assert_allclose(answers[1].confidence / 255.0, expected, atol=0.01)
    assert np.array_equal(answers[0].class_id, answers[1].class_id)
    assert 0.2 < float((answers[0].class_id == PlantClass.SOIL).mean()) < 0.8
    assert (answers[1].confidence <= answers[0].confidence).all()
