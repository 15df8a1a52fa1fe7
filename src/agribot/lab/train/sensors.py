"""Other cameras: pictures as a sensor with other channels, balance or lens would show them."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from agribot.lab.train.augment import blur

# How often a picture is changed, and, of the changed ones, how often in each way.
CHANGE_RATIO = 0.4
INFRARED_RATIO, MIX_RATIO, BALANCE_RATIO, BLUR_RATIO = 0.35, 0.4, 0.5, 0.4
# Leaves reflect more of the near infrared than of the red, soil about as much: what a leaf is
# greener than grey, times the gain, is added to the red.
INFRARED_GAIN, INFRARED_LIFT = (0.35, 1.1), (0.9, 1.15)
MIX_STD = 0.1
BALANCE = (0.72, 1.35)
BLUR_SIGMA_PX = (0.6, 1.8)


def change_sensor(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Show some of the pictures (3, S, S), in 0..255, as another camera would.

    That is one of red and near infrared, one with channels that overlap, another white balance or
    a lens out of focus, or several of these.
    """
    if rng.random() >= CHANGE_RATIO:
        return image
    if rng.random() < INFRARED_RATIO:
        image = to_red_and_infrared(image, rng.uniform(*INFRARED_GAIN), rng.uniform(*INFRARED_LIFT))
    elif rng.random() < MIX_RATIO:
        image = mix_channels(image, np.eye(3) + rng.normal(0.0, MIX_STD, (3, 3)))
    if rng.random() < BALANCE_RATIO:
        low, high = np.log(BALANCE).tolist()
        gains = torch.from_numpy(np.exp(rng.uniform(low, high, (3, 1, 1))))
        image = (image * gains.to(image.dtype)).clamp(0.0, 255.0)
    return blur(image, rng.uniform(*BLUR_SIGMA_PX)) if rng.random() < BLUR_RATIO else image


def to_red_and_infrared(image: Tensor, gain: float, lift: float) -> Tensor:
    """Show red as red and blue, and a guess of the near infrared as green, of (3, H, W)."""
    red, green, blue = image
    infrared = lift * red + gain * (2.0 * green - red - blue).clamp(min=0.0)
    return torch.stack([red, infrared.clamp(max=255.0), red])


def mix_channels(image: Tensor, mixture: np.ndarray) -> Tensor:
    """Make each channel of (3, H, W) of all three: `mixture` (3, 3), rows are what comes out.

    Grey stays grey: the rows are scaled to a sum of 1.
    """
    rows = torch.from_numpy(mixture / mixture.sum(axis=1, keepdims=True)).to(image.dtype)
    return torch.einsum("ij,jhw->ihw", rows, image).clamp(0.0, 255.0)
