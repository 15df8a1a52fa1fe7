"""Random turns and random light for photographs, on OpenCV.

Every number comes from the generator that is passed: the same state gives the same picture.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from agribot.core.messages import ByteArray

SHEAR_DEG = 6.0
FLIP_RATIO = 0.5
# Share of each change of light, and its range (1.0: all of the range 0..255).
GAMMA_RATIO, GAMMA = 0.7, (0.74, 1.35)
EXPOSURE_RATIO, BRIGHTNESS, CONTRAST = 0.7, 0.22, 0.2
BALANCE_RATIO, BALANCE_LEVELS = 0.6, 14.0
COLOUR_RATIO, HUE_DEG, SATURATION_LEVELS = 0.4, 8.0, 25.0
BLUR_RATIO, BLUR_SIGMA_PX = 0.2, (0.3, 1.2)
NOISE_RATIO, NOISE = 0.3, (0.004, 0.03)

cv2.setNumThreads(1)  # training counts its own threads, and the order of sums stays the same


def warp(
    image_rgb: ByteArray,
    label: ByteArray,
    crop_px: int,
    scale_ratio: tuple[float, float],
    rng: np.random.Generator,
    most_turn_rad: float = np.pi,
) -> tuple[ByteArray, ByteArray]:
    """Turn, shear, scale and mirror a window about its centre, and cut `crop_px` squares.

    `image_rgb` is (height, width, 3), `label` (height, width); both are continued by their mirror
    image where the square reaches over their edge. `scale_ratio` is the least and the largest
    magnification, drawn for each axis of the window.
    Returns: (crop_px, crop_px, 3) and (crop_px, crop_px).
    """
    height, width = label.shape
    turn_rad = rng.uniform(-most_turn_rad, most_turn_rad)
    shear_x, shear_y = np.tan(np.deg2rad(rng.uniform(-SHEAR_DEG, SHEAR_DEG, 2)))
    scale_x, scale_y = rng.uniform(*scale_ratio, 2)
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    linear = (
        np.array([[cos, -sin], [sin, cos]])
        @ np.array([[1.0, shear_x], [shear_y, 1.0]])
        @ np.diag([scale_x, scale_y])
    )
    if rng.random() < FLIP_RATIO:
        linear[0] *= -1.0
    centre = np.array([width - 1, height - 1]) / 2.0
    offset = (crop_px - 1) / 2.0 - linear @ centre
    crop_from_window = np.hstack([linear, offset[:, None]])
    size = (crop_px, crop_px)
    return (
        _transform(image_rgb, crop_from_window, size, cv2.INTER_LINEAR),
        _transform(label, crop_from_window, size, cv2.INTER_NEAREST),
    )


def _transform(
    picture: ByteArray, crop_from_window: npt.NDArray[np.float64], size: tuple[int, int], how: int
) -> ByteArray:
    moved = cv2.warpAffine(
        picture, crop_from_window, size, flags=how, borderMode=cv2.BORDER_REFLECT_101
    )
    return np.asarray(moved, dtype=np.uint8)


def relight(image_rgb: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Give a picture (height, width, 3) the exposure, colours, blur and noise of another camera."""
    image = np.asarray(cv2.LUT(image_rgb, _draw_levels(rng)), dtype=np.uint8)
    if rng.random() < COLOUR_RATIO:
        image = _shift_colours(image, rng)
    if rng.random() < BLUR_RATIO:
        sigma_px = rng.uniform(*BLUR_SIGMA_PX)
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.uint8)
    if rng.random() < NOISE_RATIO:
        std_levels = 255.0 * rng.uniform(*NOISE)
        noise = std_levels * rng.standard_normal(image.shape, dtype=np.float32)
        image = _to_bytes(image + noise)
    return image


def _draw_levels(rng: np.random.Generator) -> ByteArray:
    """Draw a table (1, 256, 3) for gamma, contrast, brightness and white balance."""
    levels: npt.NDArray[np.floating] = np.repeat(np.arange(256.0)[:, None], 3, axis=1)
    if rng.random() < GAMMA_RATIO:
        levels = 255.0 * (levels / 255.0) ** rng.uniform(*GAMMA)
    if rng.random() < EXPOSURE_RATIO:
        gain = 1.0 + rng.uniform(-CONTRAST, CONTRAST)
        levels = levels * gain + 255.0 * rng.uniform(-BRIGHTNESS, BRIGHTNESS)
    if rng.random() < BALANCE_RATIO:
        shift_levels = rng.uniform(-BALANCE_LEVELS, BALANCE_LEVELS, 3)
        levels = np.clip(levels, 0.0, 255.0) + shift_levels
    return _to_bytes(levels)[None]


def _shift_colours(image_rgb: ByteArray, rng: np.random.Generator) -> ByteArray:
    hsv = cv2.cvtColor(image_rgb, cv2.COLOR_RGB2HSV_FULL)
    levels = np.arange(256, dtype=np.float64)
    hue = (levels + rng.uniform(-HUE_DEG, HUE_DEG) * 256.0 / 360.0) % 256.0
    saturation = levels + rng.uniform(-SATURATION_LEVELS, SATURATION_LEVELS)
    table = np.stack([np.floor(hue), saturation, levels], axis=1)
    shifted = cv2.LUT(hsv, _to_bytes(table)[None])
    return np.asarray(cv2.cvtColor(shifted, cv2.COLOR_HSV2RGB_FULL), dtype=np.uint8)


def _to_bytes(values: npt.NDArray[np.floating]) -> ByteArray:
    rounded: ByteArray = np.clip(np.rint(values), 0.0, 255.0).astype(np.uint8)
    return rounded
