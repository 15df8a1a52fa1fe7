"""Other light: pictures as sun, shade, flare and an automatic camera would leave them.

Every change keeps each thing where it is, so that labels stay true, but for a blur of some pixels.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from agribot.core.messages import FloatArray
from agribot.lab.train.augment import change_some, to_factors

# Share of changed pictures, and, among these, the share of each change.
CHANGE_RATIO = 0.55
SHADE_RATIO, TONE_RATIO, SPLIT_RATIO, DULL_RATIO = 0.35, 0.6, 0.4, 0.5
FLARE_RATIO, SHAKE_RATIO = 0.2, 0.12
SHADE, SHADE_EDGE_RATIO = (0.2, 0.65), (0.005, 0.06)  # light left, and width of its edge
SKY_BLUE = np.array([0.92, 1.0, 1.14])  # colour of the light in a shadow
EXPOSURE, CONTRAST = (0.55, 1.9), (0.7, 1.7)
SPLIT_STD = 0.16  # spread of the logarithms of gains on dark and on bright pixels
SATURATION = (0.35, 1.25)
VEIL, GLOW, GLOW_RADIUS = (0.0, 60.0), (40.0, 260.0), (0.15, 0.7)
SHAKE_PX = (3, 7)


def change_light(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Show some of the pictures (N, 3, S, S), in 0..255, in other light.

    That is a shadow across the picture, more or less exposure and contrast, a balance that differs
    between dark and bright, duller colours, the flare of a sun before the lens or a shaken camera,
    or several of these.
    """
    chosen = rng.random(len(images)) < CHANGE_RATIO
    return change_some(images, chosen, lambda some: _change(some, rng))


def _change(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Change each of (N, 3, S, S) in some of the ways, in the order in which light goes."""
    count = len(images)

    def draw(ratio: float, low: float, high: float, neutral: float) -> FloatArray:
        """Draw (N, 1): a number between the limits for some, the neutral one for the others."""
        drawn = rng.uniform(low, high, (count, 1))
        return np.where(rng.random((count, 1)) < ratio, drawn, neutral)

    images = cast_shadows(images, draw(SHADE_RATIO, *SHADE, 1.0), rng)
    is_toned = rng.random((count, 1)) < TONE_RATIO
    low, high = np.log(EXPOSURE).tolist()
    exposures = np.exp(rng.uniform(low, high, (count, 1)))
    contrasts = rng.uniform(*CONTRAST, (count, 1))
    images = expose(images, np.where(is_toned, exposures, 1.0), np.where(is_toned, contrasts, 1.0))
    is_split = rng.random((count, 1)) < SPLIT_RATIO
    gains = np.exp(rng.normal(0.0, SPLIT_STD, (2, count, 3)))
    images = split_balance(images, *np.where(is_split, gains, 1.0))
    images = saturate(images, draw(DULL_RATIO, *SATURATION, 1.0))
    has_flare = rng.random(count) < FLARE_RATIO
    images = change_some(images, has_flare, lambda some: add_flare(some, rng))
    is_shaken = rng.random(count) < SHAKE_RATIO
    return change_some(images, is_shaken, lambda some: shake(some, rng))


def cast_shadows(images: Tensor, left: FloatArray, rng: np.random.Generator) -> Tensor:
    """Leave a share `left` (N, 1) of the light on one side of a line through each (N, 3, S, S).

    Some shadows end at a second line, as that of a mast or a wheel does.
    """
    count = len(images)
    turn_rad = rng.uniform(-math.pi, math.pi, count)
    begin, breadth = rng.uniform(-0.4, 0.4, count), rng.uniform(0.1, 1.4, count)
    edge = rng.uniform(*SHADE_EDGE_RATIO, count)
    down, right = _place_pixels(images)
    along = to_factors(np.cos(turn_rad)[:, None], images) * right
    along = along + to_factors(np.sin(turn_rad)[:, None], images) * down
    begins, ends = (to_factors(one[:, None], images) for one in (begin, begin + breadth))
    edges = to_factors(edge[:, None], images)
    inside = ((along - begins) / edges).sigmoid() * ((ends - along) / edges).sigmoid()
    shade = to_factors(np.minimum(left * SKY_BLUE, 1.0), images)
    shade = torch.where(to_factors(left, images) < 1.0, shade, torch.ones_like(shade))
    return images * (1.0 - inside * (1.0 - shade))


def expose(images: Tensor, gains: FloatArray, contrasts: FloatArray) -> Tensor:
    """Expose (N, 3, H, W) by gains (N, 1) and spread them about middle grey; the rest is cut."""
    exposed = images * to_factors(gains, images)
    return (128.0 + (exposed - 128.0) * to_factors(contrasts, images)).clamp(0.0, 255.0)


def split_balance(images: Tensor, dark_gains: FloatArray, bright_gains: FloatArray) -> Tensor:
    """Apply gains (N, 3) to black, others to white, and what lies between to the greys between."""
    bright = images.mean(dim=1, keepdim=True) / 255.0
    dark_gain, bright_gain = to_factors(dark_gains, images), to_factors(bright_gains, images)
    return (images * (dark_gain + (bright_gain - dark_gain) * bright)).clamp(0.0, 255.0)


def saturate(images: Tensor, ratios: FloatArray) -> Tensor:
    """Scale the distance from grey of (N, 3, H, W) by ratios (N, 1)."""
    grey = images.mean(dim=1, keepdim=True)
    return (grey + (images - grey) * to_factors(ratios, images)).clamp(0.0, 255.0)


def add_flare(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Add a veil of light and a glow about a point, mostly near the upper edge, to (N, 3, S, S)."""
    count = len(images)
    down, right = _place_pixels(images)
    centre_down, centre_right = rng.uniform(-0.7, 0.1, count), rng.uniform(-0.6, 0.6, count)
    away2 = (down - to_factors(centre_down[:, None], images)) ** 2
    away2 = away2 + (right - to_factors(centre_right[:, None], images)) ** 2
    radius = to_factors(rng.uniform(*GLOW_RADIUS, (count, 1)), images)
    colour = to_factors(rng.uniform(0.6, 1.0, (count, 3)), images)
    glow = to_factors(rng.uniform(*GLOW, (count, 1)), images) * torch.exp(-away2 / radius**2)
    veil = to_factors(rng.uniform(*VEIL, (count, 1)), images)
    return (images + colour * (glow + veil)).clamp(0.0, 255.0)


def shake(images: Tensor, rng: np.random.Generator) -> Tensor:
    """Blur (N, 3, H, W) along a straight way of a few pixels, right or down."""
    size = 2 * int(rng.integers(SHAKE_PX[0] // 2, SHAKE_PX[1] // 2 + 1)) + 1
    kernel = (size, 1) if rng.random() < 0.5 else (1, size)
    padding = (kernel[0] // 2, kernel[1] // 2)
    return functional.avg_pool2d(images, kernel, 1, padding, count_include_pad=False)


def _place_pixels(images: Tensor) -> tuple[Tensor, Tensor]:
    """Place rows (H, 1) and columns (1, W) from -0.5 to 0.5."""
    height, width = images.shape[2:]
    rows = (torch.arange(height) + 0.5) / height - 0.5
    columns = (torch.arange(width) + 0.5) / width - 0.5
    return rows[:, None].to(images), columns[None, :].to(images)
