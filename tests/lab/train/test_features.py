from __future__ import annotations

import numpy as np
import pytest
import torch

from agribot.core.messages import ByteArray
from agribot.lab.train.features import CHANNELS, centred_rgb, ten_channels, unit_rgb

cv2 = pytest.importorskip("cv2")


def shown(image_rgb: ByteArray) -> np.ndarray:
    return ten_channels(torch.from_numpy(image_rgb).permute(2, 0, 1)[None])[0].numpy()


def test_the_ten_channels_are_their_formulas() -> None:
    image_rgb = np.random.default_rng(0).integers(1, 256, (40, 30, 3), dtype=np.uint8)
    r, g, b = np.moveaxis(image_rgb.astype(np.float64), 2, 0)
    hsv = cv2.cvtColor(image_rgb.astype(np.float32), cv2.COLOR_RGB2HSV)
    expected = [
        r / 255,
        g / 255,
        b / 255,
        (2 * g - r - b) / 255,
        (1.4 * r - g) / 255,
        (0.881 * g - 0.441 * r - 0.385 * b - 18.78745) / 255,
        (g - r) / (g + r),
        hsv[..., 0] / 360,
        hsv[..., 1],
        hsv[..., 2] / 255,
    ]
    found = shown(image_rgb)
    assert len(found) == len(CHANNELS)
    for name, one, other in zip(CHANNELS, found, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-5, err_msg=name)


@pytest.mark.parametrize(
    "colour", [(0, 0, 0), (255, 255, 255), (0, 0, 255), (255, 0, 0), (7, 7, 7), (0, 1, 0)]
)
def test_every_flat_image_has_finite_channels_of_modest_size(colour: tuple[int, int, int]) -> None:
    found = shown(np.full((4, 4, 3), colour, np.uint8))
    assert np.isfinite(found).all()
    assert np.abs(found).max() <= 2.0


def test_black_has_no_vegetation_index() -> None:
    found = dict(zip(CHANNELS, shown(np.zeros((1, 1, 3), np.uint8))[:, 0, 0], strict=True))
    assert found["NDI"] == 0.0
    assert found["-CIVE"] == pytest.approx(-18.78745 / 255)


def test_plain_colours_span_their_ranges() -> None:
    ramp = torch.tensor([0, 255], dtype=torch.uint8).view(1, 1, 1, 2).expand(1, 3, 1, 2)
    assert centred_rgb(ramp).flatten().tolist() == [-1.0, 1.0] * 3
    assert unit_rgb(ramp).flatten().tolist() == [0.0, 1.0] * 3
