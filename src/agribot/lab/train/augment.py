"""Augment training images: random windows, at random scales, in other light; a batch at a time.

All of a batch is computed at once, on the device where its pictures lie.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn import functional

from agribot.lab.train.picture_stack import Numbers, PictureStack

# Around the scale at which the network sees a camera image (512 of 640 pixels).
SCALE_RATIO = (0.6, 1.3)
BLUR_RATIO, BLUR_SIGMA_PX = 0.2, (0.3, 1.2)
NOISE_STD = (0.0, 4.0)
WINDOW_TRIES = 2
FINE = 2  # samples along each side of a pixel, so that what is shrunk does not alias


class PictureWindows(NamedTuple):
    """A square of each of some pictures, (N,) each, to be shown `size_px` wide."""

    top: Numbers
    left: Numbers
    source_px: Numbers
    is_mirrored: npt.NDArray[np.bool_]
    size_px: int

    def place_samples(self, device: torch.device, fine: int = 1) -> tuple[Tensor, Tensor]:
        """Find rows and columns of the pictures for the shown ones, (N, size_px * fine)."""
        samples = self.size_px * fine
        share = (torch.arange(samples, dtype=torch.float64) + 0.5) / samples
        along = share * torch.from_numpy(self.source_px)[:, None] - 0.5
        mirrored = torch.from_numpy(self.is_mirrored)[:, None]
        across = torch.where(mirrored, along.flip(1), along)
        limit = torch.from_numpy(self.source_px)[:, None] - 1.0
        rows = along.clamp(min=0.0).minimum(limit) + torch.from_numpy(self.top)[:, None]
        columns = across.clamp(min=0.0).minimum(limit) + torch.from_numpy(self.left)[:, None]
        return rows.to(device), columns.to(device)

    def cut_images(self, images_rgb: Tensor) -> Tensor:
        """Cut (N, H, W, 3) uint8 to float32 (N, 3, size_px, size_px)."""
        _, height, width, _ = images_rgb.shape
        rows, columns = (
            one.to(torch.float32) for one in self.place_samples(images_rgb.device, FINE)
        )
        down = (2.0 * rows + 1.0) / height - 1.0
        right = (2.0 * columns + 1.0) / width - 1.0
        samples = self.size_px * FINE
        places = torch.stack(
            [right[:, None, :].expand(-1, samples, -1), down[:, :, None].expand(-1, -1, samples)],
            dim=-1,
        )
        images = images_rgb.permute(0, 3, 1, 2).to(torch.float32)
        cut = functional.grid_sample(images, places, padding_mode="border", align_corners=False)
        return functional.avg_pool2d(cut, FINE)

    def cut_pixels(self, pixels: Tensor) -> Tensor:
        """Cut whole numbers (N, H, W), such as classes, to int64 (N, size_px, size_px)."""
        rows, columns = (one.round().to(torch.int64) for one in self.place_samples(pixels.device))
        picture = torch.arange(len(pixels), device=pixels.device)[:, None, None]
        return pixels[picture, rows[:, :, None], columns[:, None, :]].to(torch.int64)

    def move_points(self, points_px: Tensor) -> Tensor:
        """Move points (N, K, 2) of the pictures, u and v, into the cut."""
        corners = torch.from_numpy(np.stack([self.left, self.top], axis=1)).to(points_px)
        scale = torch.from_numpy(self.size_px / self.source_px).to(points_px)[:, None]
        moved = (points_px - corners[:, None, :] + 0.5) * scale[:, None] - 0.5
        mirrored = torch.from_numpy(self.is_mirrored).to(points_px.device)[:, None]
        u = torch.where(mirrored, self.size_px - 1.0 - moved[..., 0], moved[..., 0])
        return torch.stack([u, moved[..., 1]], dim=-1)


def choose_windows(
    stack: PictureStack, chosen: Numbers, size_px: int, rng: np.random.Generator
) -> PictureWindows:
    """Choose a square of each chosen picture; of some tries the one with most weed, the rare class.

    None is larger than its picture, so that it holds no invented pixels.
    """
    count, (rows, columns) = len(chosen), stack.shape
    scale = np.exp(rng.uniform(math.log(SCALE_RATIO[0]), math.log(SCALE_RATIO[1]), count))
    source_px = np.minimum(np.round(size_px / scale), min(rows, columns)).astype(np.int64)
    tries = rng.integers(1, WINDOW_TRIES + 1, count)
    top, left = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    most = np.full(count, -1)
    for attempt in range(WINDOW_TRIES):
        other_top = rng.integers(rows - source_px + 1)
        other_left = rng.integers(columns - source_px + 1)
        weed_px = stack.count_weeds(chosen, other_top, other_left, source_px)
        is_better = (weed_px > most) & (attempt < tries)
        top, left = np.where(is_better, other_top, top), np.where(is_better, other_left, left)
        most = np.where(is_better, weed_px, most)
    return PictureWindows(top, left, source_px, rng.random(count) < 0.5, size_px)


def augment_batch(
    stack: PictureStack, count: int, crop_px: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Make (count, 3, crop_px, crop_px) float32 in 0..255 and (count, crop_px, crop_px) int64."""
    chosen = stack.choose(count, rng)
    windows = choose_windows(stack, chosen, crop_px, rng)
    images = recolour(windows.cut_images(stack.images[chosen]), rng)
    return images, windows.cut_pixels(stack.labels[chosen])


def recolour(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Vary exposure, contrast, white balance, gamma, blur and noise of (N, 3, S, S) in 0..255."""
    count = len(images)

    def draw(low: float, high: float, channels: int = 1) -> Tensor:
        return to_factors(rng.uniform(low, high, (count, channels)), images)

    images = (images * (draw(0.85, 1.18) * draw(0.95, 1.05, 3))).clamp(0.0, 255.0)
    images = 255.0 * (images / 255.0) ** draw(0.85, 1.18)
    grey = images.mean(dim=1, keepdim=True)
    images = grey + (images - grey) * draw(0.85, 1.15)
    mean = images.mean(dim=(1, 2, 3), keepdim=True)
    images = mean + (images - mean) * draw(0.9, 1.12)
    images = blur_some(images, BLUR_RATIO, BLUR_SIGMA_PX, rng)
    noise = torch.randn(images.shape, generator=seed_generator(images.device, rng),
                        device=images.device)  # fmt: skip
    return (images + draw(*NOISE_STD) * noise).clamp(0.0, 255.0)


def to_factors(values: npt.NDArray[np.float64], images: Tensor) -> Tensor:
    """Bring values (N, channels) to the images' device, as (N, channels, 1, 1)."""
    return torch.from_numpy(values[:, :, None, None]).to(images)


def seed_generator(device: torch.device, rng: np.random.Generator) -> torch.Generator:
    return torch.Generator(device).manual_seed(int(rng.integers(2**63)))


def change_some(
    images: Tensor, chosen: npt.NDArray[np.bool_], change: Callable[[Tensor], Tensor]
) -> Tensor:
    """Change the chosen ones (N,) of (N, 3, H, W), all at once; the others stay."""
    if not chosen.any():
        return images
    images = images.clone()
    images[chosen] = change(images[chosen])
    return images


def blur_some(
    images: Tensor, share: float, sigma_px: tuple[float, float], rng: np.random.Generator
) -> Tensor:
    """Blur a share of (N, 3, H, W), each by a random sigma."""
    chosen = rng.random(len(images)) < share
    sigmas_px = torch.from_numpy(rng.uniform(*sigma_px, len(images))[chosen])
    return change_some(images, chosen, lambda some: blur(some, sigmas_px))


def blur(images: Tensor, sigmas_px: Tensor) -> Tensor:
    """Blur (N, 3, H, W) with Gaussians (N,), cut off three pixels on each side."""
    count, channels, *_ = images.shape
    taps = torch.exp(-0.5 * (torch.arange(-3.0, 4.0) / sigmas_px[:, None]) ** 2)
    taps = (taps / taps.sum(dim=1, keepdim=True)).to(images).repeat_interleave(channels, dim=0)
    padded = functional.pad(images, (3, 3, 3, 3), mode="reflect").flatten(0, 1)[None]
    across = functional.conv2d(padded, taps.view(-1, 1, 1, 7), groups=count * channels)
    down = functional.conv2d(across, taps.view(-1, 1, 7, 1), groups=count * channels)
    return down[0].view_as(images)
