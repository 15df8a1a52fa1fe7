"""Augment a training image: a random crop, at a random scale, in other light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn import functional

from agribot.core.messages import ByteArray, FloatArray, PlantClass
from agribot.lab.train.losses import IGNORED

# Around the scale at which the network sees a camera image (512 of 640 pixels).
SCALE_RATIO = (0.6, 1.3)
BLUR_SIGMA_PX = 1.2
WINDOW_TRIES = 2


class PictureWindow(NamedTuple):
    """A square of a picture, `source_px` wide at `window`, shown `size_px` wide."""

    window: tuple[slice, slice]  # rows, columns
    source_px: int
    size_px: int
    is_mirrored: bool

    def cut_image(self, image_rgb: ByteArray) -> Tensor:
        """Cut (H, W, 3) to float32 (3, size_px, size_px)."""
        image = torch.from_numpy(image_rgb[self.window].copy()).permute(2, 0, 1)[None]
        size = (self.size_px, self.size_px)
        cut = functional.interpolate(
            image.to(torch.float32), size, mode="bilinear", align_corners=False,
            antialias=self.source_px > self.size_px,
        )[0]  # fmt: skip
        return cut.flip(-1) if self.is_mirrored else cut

    def cut_label(self, label: ByteArray | npt.NDArray[np.uint16]) -> Tensor:
        """Cut (H, W) to int64 (size_px, size_px), by the nearest pixel."""
        target = torch.from_numpy(label[self.window].astype(np.float32))[None, None]
        size = (self.size_px, self.size_px)
        cut = functional.interpolate(target, size, mode="nearest-exact")[0, 0].to(torch.int64)
        return cut.flip(-1) if self.is_mirrored else cut

    def move_points(self, points_px: FloatArray) -> FloatArray:
        """Where points (N, 2) of the picture, u and v, lie in what is cut."""
        rows, columns = self.window
        scale = self.size_px / self.source_px
        moved: FloatArray = (points_px - (columns.start, rows.start) + 0.5) * scale - 0.5
        if self.is_mirrored:
            moved[:, 0] = self.size_px - 1.0 - moved[:, 0]
        return moved


def augment_batch(
    images_rgb: list[ByteArray], labels: list[ByteArray], crop_px: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Make (N, 3, crop_px, crop_px) float32 in 0..255 and (N, crop_px, crop_px) int64."""
    crops = [choose_crop(label, crop_px, rng) for label in labels]
    images = torch.stack(
        [recolour(c.cut_image(i), rng) for c, i in zip(crops, images_rgb, strict=True)]
    )
    return images, torch.stack([c.cut_label(i) for c, i in zip(crops, labels, strict=True)])


def choose_crop(label: ByteArray, crop_px: int, rng: np.random.Generator) -> PictureWindow:
    """Choose a random crop of an image with these classes (H, W), at a random scale."""
    scale = float(np.exp(rng.uniform(*np.log(SCALE_RATIO))))
    # Never larger than the image, so that a crop holds no invented pixels.
    source_px = min(round(crop_px / scale), *label.shape)
    window = _window(label, source_px, rng)
    return PictureWindow(window, source_px, crop_px, bool(rng.random() < 0.5))


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


def recolour(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Vary exposure, contrast, white balance, gamma, blur and noise."""
    gain = torch.from_numpy(rng.uniform(0.85, 1.18) * rng.uniform(0.95, 1.05, (3, 1, 1)))
    image = (image * gain.to(torch.float32)).clamp(0.0, 255.0)
    image = 255.0 * (image / 255.0) ** rng.uniform(0.85, 1.18)
    grey = image.mean(dim=0, keepdim=True)
    image = grey + (image - grey) * rng.uniform(0.85, 1.15)
    mean = image.mean()
    image = mean + (image - mean) * rng.uniform(0.9, 1.12)
    if rng.random() < 0.2:
        image = blur(image, rng.uniform(0.3, BLUR_SIGMA_PX))
    noise_std = rng.uniform(0.0, 4.0)
    noise = torch.from_numpy(rng.standard_normal(image.shape, dtype=np.float32))
    return (image + noise_std * noise).clamp(0.0, 255.0)


def blur(image: Tensor, sigma_px: float) -> Tensor:
    """Blur (3, H, W) with a Gaussian, of which three pixels on each side are kept."""
    taps = torch.exp(-0.5 * (torch.arange(-3.0, 4.0) / sigma_px) ** 2)
    taps = (taps / taps.sum()).to(image.dtype)
    padded = functional.pad(image[:, None], (3, 3, 3, 3), mode="reflect")
    across = functional.conv2d(padded, taps.view(1, 1, 1, 7))
    return functional.conv2d(across, taps.view(1, 1, 7, 1))[:, 0]


def clean_labels(label: ByteArray) -> ByteArray:
    """Turn what is no class in (H, W), such as a renderer's sky, into pixels that do not count."""
    return np.where(label < 3, label, np.uint8(IGNORED))
