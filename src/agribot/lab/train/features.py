"""The input of a network: plain colours, or the colour indices of the original."""

from __future__ import annotations

import torch
from torch import Tensor

CHANNELS = (
    "red", "green", "blue", "ExG", "ExR", "-CIVE", "NDI", "hue", "saturation", "value",
)  # fmt: skip


def centred_rgb(image_rgb: Tensor) -> Tensor:
    """Scale (N, 3, H, W) uint8 or float in 0..255 to [-1, 1]."""
    return image_rgb.to(torch.float32) * (2.0 / 255.0) - 1.0


def unit_rgb(image_rgb: Tensor) -> Tensor:
    """Scale (N, 3, H, W) in 0..255 to [0, 1]."""
    return image_rgb.to(torch.float32) / 255.0


def ten_channels(image_rgb: Tensor) -> Tensor:
    """Convert (N, 3, H, W) in 0..255 to the ten CHANNELS, finite on every image.

    Excess green and red, the colour index of vegetation extraction with its sign turned and the
    normalised difference index (0 on black, where it is undefined); then hue over 360 degrees,
    saturation and value as in OpenCV. Source: Milioto et al. 2018, with the constants of the
    original robot.
    """
    red, green, blue = image_rgb.to(torch.float32).unbind(dim=1)
    excess_green = (2.0 * green - red - blue) / 255.0
    excess_red = (1.4 * red - green) / 255.0
    cive = (0.881 * green - 0.441 * red - 0.385 * blue - 18.78745) / 255.0
    # Green equals red equals 0 on black: any divisor gives the 0 that is wanted.
    ndi = (green - red) / (green + red).clamp(min=1e-6)
    hue, saturation, value = _hsv(red, green, blue)
    colours = (red / 255.0, green / 255.0, blue / 255.0)
    indices = (excess_green, excess_red, cive, ndi)
    return torch.stack([*colours, *indices, hue, saturation, value / 255.0], dim=1)


def _hsv(red: Tensor, green: Tensor, blue: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Compute hue and saturation in [0, 1], value in the unit of the input."""
    value = torch.maximum(torch.maximum(red, green), blue)
    spread = value - torch.minimum(torch.minimum(red, green), blue)
    divisor = torch.where(spread > 0.0, spread, torch.ones_like(spread))
    sixth = torch.where(
        value == red,
        (green - blue) / divisor,
        torch.where(value == green, 2.0 + (blue - red) / divisor, 4.0 + (red - green) / divisor),
    )
    sixth = torch.where(sixth < 0.0, sixth + 6.0, sixth)
    saturation = spread / torch.where(value > 0.0, value, torch.ones_like(value))
    return sixth / 6.0, saturation, value
