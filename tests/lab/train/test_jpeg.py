from __future__ import annotations

import io

import numpy as np
import pytest
import torch
from PIL import Image

from agribot.core.messages import ByteArray
from agribot.lab.train.jpeg import compress
from agribot.lab.train.sensors import JPEG_QUALITY, compress_some
from tests.lab.train.drawn_images import drawn_image

PICTURE = drawn_image(np.random.default_rng(5))[0]


def save_as_jpeg(image_rgb: ByteArray, quality: int) -> ByteArray:
    file = io.BytesIO()
    Image.fromarray(image_rgb).save(file, format="JPEG", quality=quality, subsampling="4:2:0")
    return np.asarray(Image.open(file))


def to_batch(image_rgb: ByteArray, count: int = 1) -> torch.Tensor:
    return torch.from_numpy(image_rgb.copy()).permute(2, 0, 1).float().expand(count, -1, -1, -1)


@pytest.mark.parametrize("quality", [30, 60, 80, 95])
def test_pictures_look_as_a_jpeg_library_leaves_them(quality: int) -> None:
    expected = save_as_jpeg(PICTURE, quality).astype(float)
    shown = compress(to_batch(PICTURE), np.array([float(quality)]))[0].permute(1, 2, 0).numpy()
    lost = np.abs(expected - PICTURE).mean()
    assert np.abs(shown - expected).mean() < 0.35 * lost


def test_each_picture_of_a_batch_has_its_own_quality() -> None:
    shown = compress(to_batch(PICTURE, 3), np.array([95.0, 20.0, 60.0]))
    for one, quality in zip(shown, (95.0, 20.0, 60.0), strict=True):
        alone = compress(to_batch(PICTURE), np.array([quality]))[0]
        assert torch.allclose(one, alone, atol=1e-3)
    lost = (shown - to_batch(PICTURE, 3)).abs().mean(dim=(1, 2, 3)).tolist()
    assert lost[0] < lost[2] < lost[1]


def test_some_pictures_are_compressed_and_all_stay_pictures() -> None:
    images = to_batch(PICTURE, 100)
    shown = compress_some(images, np.random.default_rng(1))
    changed = (shown != images).flatten(1).any(dim=1).float().mean()
    assert 0.3 < float(changed) < 0.7
    assert float(shown.min()) >= 0.0 and float(shown.max()) <= 255.0
    assert 0.0 < JPEG_QUALITY[0] < JPEG_QUALITY[1] <= 100.0
