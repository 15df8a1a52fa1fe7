"""Augment a training image: a random crop, at a random scale, in other light."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.train.losses import IGNORED

# Around the scale at which the network sees a camera image (512 of 640 pixels).
SCALE_RATIO = (0.6, 1.3)
BLUR_SIGMA_PX = 1.2
WINDOW_TRIES = 2


def augment_batch(
    images_rgb: list[ByteArray], labels: list[ByteArray], crop_px: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Make (N, 3, crop_px, crop_px) float32 in 0..255 and (N, crop_px, crop_px) int64."""
    crops = [_crop(i, c, crop_px, rng) for i, c in zip(images_rgb, labels, strict=True)]
    images = torch.stack([_recolour(image, rng) for image, _ in crops])
    return images, torch.stack([label for _, label in crops])


def _crop(
    image_rgb: ByteArray, label: ByteArray, crop_px: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    scale = float(np.exp(rng.uniform(*np.log(SCALE_RATIO))))
    # Never larger than the image, so that a crop holds no invented pixels.
    source_px = min(round(crop_px / scale), *label.shape)
    window = _window(label, source_px, rng)
    image = torch.from_numpy(image_rgb[window].copy()).permute(2, 0, 1)[None].to(torch.float32)
    target = torch.from_numpy(label[window].copy())[None, None].to(torch.float32)
    size = (crop_px, crop_px)
    image = functional.interpolate(
        image, size, mode="bilinear", align_corners=False, antialias=source_px > crop_px
    )
    target = functional.interpolate(target, size, mode="nearest-exact")
    image, target = image[0], target[0, 0].to(torch.int64)
    if rng.random() < 0.5:
        image, target = image.flip(-1), target.flip(-1)
    return image, target


def _window(label: ByteArray, size_px: int, rng: np.random.Generator) -> tuple[slice, slice]:
    """Choose a random square; of several tries the one with most weed, the rare class."""
    height, width = label.shape
    best, most = (slice(0, size_px), slice(0, size_px)), -1
    for _ in range(int(rng.integers(1, WINDOW_TRIES + 1))):
        top = int(rng.integers(height - size_px + 1))
        left = int(rng.integers(width - size_px + 1))
        window = (slice(top, top + size_px), slice(left, left + size_px))
        weed_px = int((label[window] == PlantClass.WEED).sum())
        if weed_px > most:
            best, most = window, weed_px
    return best


def _recolour(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Vary exposure, contrast, white balance, gamma, blur and noise."""
    gain = torch.from_numpy(rng.uniform(0.85, 1.18) * rng.uniform(0.95, 1.05, (3, 1, 1)))
    image = (image * gain.to(torch.float32)).clamp(0.0, 255.0)
    image = 255.0 * (image / 255.0) ** rng.uniform(0.85, 1.18)
    grey = image.mean(dim=0, keepdim=True)
    image = grey + (image - grey) * rng.uniform(0.85, 1.15)
    mean = image.mean()
    image = mean + (image - mean) * rng.uniform(0.9, 1.12)
    if rng.random() < 0.2:
        image = _blur(image, rng.uniform(0.3, BLUR_SIGMA_PX))
    noise_std = rng.uniform(0.0, 4.0)
    noise = torch.from_numpy(rng.standard_normal(image.shape, dtype=np.float32))
    return (image + noise_std * noise).clamp(0.0, 255.0)


def _blur(image: Tensor, sigma_px: float) -> Tensor:
    taps = torch.exp(-0.5 * (torch.arange(-3.0, 4.0) / sigma_px) ** 2)
    taps = (taps / taps.sum()).to(image.dtype)
    padded = functional.pad(image[:, None], (3, 3, 3, 3), mode="reflect")
    across = functional.conv2d(padded, taps.view(1, 1, 1, 7))
    return functional.conv2d(across, taps.view(1, 1, 7, 1))[:, 0]


def clean_labels(label: ByteArray) -> ByteArray:
    """Turn what is no class in (H, W), such as a renderer's sky, into pixels that do not count."""
    return np.where(label < 3, label, np.uint8(IGNORED))
