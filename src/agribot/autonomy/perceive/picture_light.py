"""Whether the light, the focus and the noise of a picture let plants be seen in it at all.

The limits lie between 354 photographs of four fields, 28 drawn pictures, and pictures that show
nothing; measured on the green channel, averaged to about 320 px across.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.core.facts import (
    AnyFact,
    OneBrightness,
    OutOfFocus,
    Overexposed,
    PictureNoisy,
    TooDark,
)
from agribot.core.messages import ByteArray

Floats = npt.NDArray[np.float32]

WIDTH_PX = 320  # across the averaged picture
COARSE_PX = 4  # pixels of it for each pixel of the coarse one
DARK = 40.0  # least level of 255 of the brightest 5 %; fields 98 to 254, nights 7 to 9
WHITE, MOST_WHITE_RATIO = 250.0, 0.5  # fields up to 0.14
LEAST_CONTRAST = 5.0  # standard deviation, of 255; fields from 17
# Correlation of neighbouring pixels: fields from 0.61, noise 0.
LEAST_CORRELATION = 0.45
# Edges of the averaged picture over those of the coarse one: fields from 0.52, a blur of 3 px
# (1 sigma, of 640) up to 0.20.
LEAST_SHARPNESS = 0.3


def find_fault(image_rgb: ByteArray) -> AnyFact | None:
    """Find why a picture (H, W, 3) can show no plants; None where it may."""
    fine = _average(image_rgb[..., 1], max(1, round(image_rgb.shape[1] / WIDTH_PX)))
    if fine.size == 0 or (bright := float(np.percentile(fine, 95.0))) < DARK:
        return TooDark()
    if (white := float((fine >= WHITE).mean())) > MOST_WHITE_RATIO:
        return Overexposed(white)
    if float(fine.std()) < LEAST_CONTRAST:
        return OneBrightness(bright)
    steps = float((np.diff(fine, axis=1) ** 2).mean())
    if 1.0 - steps / (2.0 * float(fine.var())) < LEAST_CORRELATION:
        return PictureNoisy()
    if _measure_sharpness(fine) < LEAST_SHARPNESS:
        return OutOfFocus()
    return None


def _average(values: ByteArray, block_px: int) -> Floats:
    """Average (H, W) in square blocks."""
    height, width = (size // block_px * block_px for size in values.shape)
    total = np.zeros((height // block_px, width // block_px), np.float32)
    for down in range(block_px):
        for right in range(block_px):
            total += values[down:height:block_px, right:width:block_px]
    total /= block_px**2
    return total


def _measure_sharpness(fine: Floats) -> float:
    """Compare fine edges with coarse ones."""
    height, width = (size // COARSE_PX * COARSE_PX for size in fine.shape)
    if min(height, width) < 3 * COARSE_PX:
        return LEAST_SHARPNESS  # too small a picture to judge
    blocks = fine[:height, :width].reshape(height // COARSE_PX, COARSE_PX, -1, COARSE_PX)
    coarse = float(_find_edges(blocks.mean(axis=(1, 3))).std())
    return float(_find_edges(fine).std()) / max(coarse, 1e-3)


def _find_edges(values: Floats) -> Floats:
    """Apply the Laplace operator to (H, W)."""
    edges: Floats = 4.0 * values[1:-1, 1:-1] - values[:-2, 1:-1] - values[2:, 1:-1]
    return edges - values[1:-1, :-2] - values[1:-1, 2:]
