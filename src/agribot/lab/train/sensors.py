"""Other cameras: pictures as a sensor with other channels, balance or lens would show them."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from agribot.core.messages import FloatArray
from agribot.lab.train.augment import blur_some, change_some, to_factors
from agribot.lab.train.jpeg import compress

# Share of changed pictures, and, among these, the share of each change.
CHANGE_RATIO = 0.4
INFRARED_RATIO, MIX_RATIO, BALANCE_RATIO, BLUR_RATIO = 0.35, 0.4, 0.5, 0.4
# Leaves reflect more of the near infrared than of the red, soil about as much: what a leaf is
# greener than grey, times the gain, is added to the red.
INFRARED_GAIN, INFRARED_LIFT = (0.35, 1.1), (0.9, 1.15)
MIX_STD = 0.1
BALANCE = (0.72, 1.35)
BLUR_SIGMA_PX = (0.6, 1.8)
# Share of JPEG pictures, and the range of their quality.
JPEG_RATIO, JPEG_QUALITY = 0.5, (40.0, 97.0)


def change_sensors(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Show some of the pictures (N, 3, S, S), in 0..255, as other cameras would.

    That is one of red and near infrared, one with channels that overlap, another white balance or
    a lens out of focus, or several of these.
    """
    chosen = rng.random(len(images)) < CHANGE_RATIO
    return change_some(images, chosen, lambda some: _change(some, rng))


def compress_some(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Show some of the pictures (N, 3, S, S), in 0..255, as JPEG leaves them."""
    chosen = rng.random(len(images)) < JPEG_RATIO
    qualities = rng.uniform(*JPEG_QUALITY, len(images))[chosen]
    return change_some(images, chosen, lambda some: compress(some, qualities))


def _change(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Change each of (N, 3, S, S) in some of the ways."""
    count = len(images)
    is_infrared = rng.random(count) < INFRARED_RATIO
    is_mixed = ~is_infrared & (rng.random(count) < MIX_RATIO)
    gains, lifts = rng.uniform(*INFRARED_GAIN, count), rng.uniform(*INFRARED_LIFT, count)
    mixtures = np.eye(3) + rng.normal(0.0, MIX_STD, (count, 3, 3))
    images = change_some(
        images,
        is_infrared,
        lambda some: to_red_and_infrared(some, gains[is_infrared], lifts[is_infrared]),
    )
    images = change_some(images, is_mixed, lambda some: mix_channels(some, mixtures[is_mixed]))
    low, high = np.log(BALANCE).tolist()
    is_balanced = rng.random((count, 1)) < BALANCE_RATIO
    balances = np.where(is_balanced, np.exp(rng.uniform(low, high, (count, 3))), 1.0)
    images = (images * to_factors(balances, images)).clamp(0.0, 255.0)
    return blur_some(images, BLUR_RATIO, BLUR_SIGMA_PX, rng)


def to_red_and_infrared(images: Tensor, gains: FloatArray, lifts: FloatArray) -> Tensor:
    """Show red as red and blue, and a guess of the near infrared as green, of (N, 3, H, W)."""
    red, green, blue = (images[:, one : one + 1] for one in range(3))
    gain, lift = (to_factors(one[:, None], images) for one in (gains, lifts))
    infrared = lift * red + gain * (2.0 * green - red - blue).clamp(min=0.0)
    return torch.cat([red, infrared.clamp(max=255.0), red], dim=1)


def mix_channels(images: Tensor, mixtures: FloatArray) -> Tensor:
    """Make each channel of (N, 3, H, W) of all three: `mixtures` (N, 3, 3), rows come out.

    Grey stays grey: the rows are scaled to a sum of 1.
    """
    rows = torch.from_numpy(mixtures / mixtures.sum(axis=2, keepdims=True)).to(images)
    return torch.einsum("nij,njhw->nihw", rows, images).clamp(0.0, 255.0)
