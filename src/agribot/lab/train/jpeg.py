"""What JPEG leaves of pictures, a batch at a time, on the device where they lie.

Cameras on USB and networks send JPEG, and photographs are kept as such: its blocks blur fine leaves
and their colours. Source: ITU-T T.81 (1992), tables of annex K, scaled by quality as libjpeg does;
colours at half the resolution.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn import functional

from agribot.core.messages import FloatArray

BLOCK_PX = 8
MULTIPLE_PX = 2 * BLOCK_PX  # multiple of the pictures' size: a block of colours is of four blocks
LUMINANCE = np.array(
    [
        [16, 11, 10, 16, 24, 40, 51, 61],
        [12, 12, 14, 19, 26, 58, 60, 55],
        [14, 13, 16, 24, 40, 57, 69, 56],
        [14, 17, 22, 29, 51, 87, 80, 62],
        [18, 22, 37, 56, 68, 109, 103, 77],
        [24, 35, 55, 64, 81, 104, 113, 92],
        [49, 64, 78, 87, 103, 121, 120, 101],
        [72, 92, 95, 98, 112, 100, 103, 99],
    ]
)
CHROMINANCE = np.full((BLOCK_PX, BLOCK_PX), 99)
CHROMINANCE[:4, :4] = [[17, 18, 24, 47], [18, 21, 26, 66], [24, 26, 56, 99], [47, 66, 99, 99]]
# Source: ITU-T T.871 (JFIF).
YCC_FROM_RGB = np.array(
    [[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]]
)


def compress(images: Tensor, qualities: FloatArray) -> Tensor:
    """Return (N, 3, H, W) in 0..255 as JPEG of these qualities (N,), 1 to 100, would show them.

    H and W are multiples of MULTIPLE_PX.
    """
    forth = torch.from_numpy(YCC_FROM_RGB).to(images)
    back = torch.from_numpy(np.linalg.inv(YCC_FROM_RGB)).to(images)
    ycc = torch.einsum("ij,njhw->nihw", forth, images)
    luminance = _quantise(ycc[:, :1] - 128.0, LUMINANCE, qualities) + 128.0
    small = _quantise(functional.avg_pool2d(ycc[:, 1:], 2), CHROMINANCE, qualities)
    colours = functional.interpolate(small, scale_factor=2.0, mode="bilinear", align_corners=False)
    shown = torch.einsum("ij,njhw->nihw", back, torch.cat([luminance, colours], dim=1))
    return shown.clamp(0.0, 255.0)


def _quantise(planes: Tensor, table: npt.NDArray[np.int64], qualities: FloatArray) -> Tensor:
    """Round the cosine transform of every block of (N, C, H, W) to the steps of a table."""
    count, channels, height, width = planes.shape
    cosines = torch.from_numpy(_make_cosines()).to(planes)
    steps = torch.from_numpy(_scale_table(table, qualities)).to(planes)[:, None, None, None]
    shape = (count, channels, height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
    blocks = planes.reshape(shape).transpose(3, 4)
    rounded = (cosines @ blocks @ cosines.T / steps).round() * steps
    return (cosines.T @ rounded @ cosines).transpose(3, 4).reshape(planes.shape)


def _make_cosines() -> FloatArray:
    """Make the orthonormal cosine transform of a block's columns, (8, 8)."""
    index = np.arange(BLOCK_PX)
    waves = np.cos(np.pi * (2 * index[None, :] + 1) * index[:, None] / (2 * BLOCK_PX))
    waves[0] /= np.sqrt(2.0)
    cosines: FloatArray = waves * np.sqrt(2.0 / BLOCK_PX)
    return cosines


def _scale_table(table: npt.NDArray[np.int64], qualities: FloatArray) -> FloatArray:
    """Scale a table (8, 8) to qualities (N,): (N, 8, 8)."""
    percent = np.where(qualities < 50.0, 5000.0 / qualities, 200.0 - 2.0 * qualities)
    scaled: FloatArray = np.floor((table * percent[:, None, None] + 50.0) / 100.0).clip(1.0, 255.0)
    return scaled
