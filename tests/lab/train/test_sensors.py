from __future__ import annotations

import numpy as np
import pytest
import torch

from agribot.lab.train.sensors import change_sensors, mix_channels, to_red_and_infrared

SOIL_RGB, LEAF_RGB = (110.0, 90.0, 80.0), (60.0, 120.0, 45.0)


def paint(rgb: tuple[float, float, float]) -> torch.Tensor:
    return torch.tensor(rgb).view(1, 3, 1, 1).expand(1, 3, 16, 16).clone()


def show_red_and_infrared(rgb: tuple[float, float, float]) -> torch.Tensor:
    return to_red_and_infrared(paint(rgb), gains=np.array([0.7]), lifts=np.array([1.0]))[0]


def test_leaves_are_bright_in_the_infrared_and_soil_is_grey() -> None:
    red, infrared, blue = show_red_and_infrared(LEAF_RGB)
    assert torch.equal(red, blue) and float(infrared.min()) > 2.0 * float(red.max())
    red, infrared, _ = show_red_and_infrared(SOIL_RGB)
    assert torch.equal(red, infrared)


def test_mixed_channels_leave_grey_grey() -> None:
    mixture = np.eye(3) + np.random.default_rng(4).normal(0.0, 0.2, (1, 3, 3))
    np.testing.assert_allclose(mix_channels(paint((90.0,) * 3), mixture).numpy(), 90.0, rtol=1e-5)
    assert not torch.allclose(mix_channels(paint(LEAF_RGB), mixture), paint(LEAF_RGB), atol=2.0)


def test_most_pictures_are_those_of_the_robots_camera_and_all_are_pictures() -> None:
    image = torch.rand((3, 24, 24), generator=torch.Generator().manual_seed(2)) * 255.0
    images = image.expand(200, 3, 24, 24)
    changed = change_sensors(images, np.random.default_rng(1))
    assert changed.shape == images.shape
    assert 0.5 < np.mean([torch.equal(image, one) for one in changed]) < 0.75
    assert float(changed.min()) >= 0.0 and float(changed.max()) <= 255.0 + 1e-3


@pytest.mark.parametrize("seed", range(3))
def test_the_same_state_gives_the_same_sensor(seed: int) -> None:
    image = paint(LEAF_RGB)
    first, again = (change_sensors(image, np.random.default_rng(seed)) for _ in range(2))
    assert torch.equal(first, again)
