"""How likely each pixel shows a plant, and most of all crop: by its colour and by a network."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.core.messages import ByteArray, FloatArray, PlantClass

COVER_GREEN = (0.06, 0.14)  # excess of green of no cover and of full cover with plants
# Excess of green of soil by white balance, either way, the least share of soil in a picture that
# shows it, and the step from pixel to pixel, down and across.
MOST_SOIL_GREEN, LEAST_SOIL_RATIO, SOIL_STEP = 0.1, 0.05, 7
NETWORK_SHARE = 0.6  # the network's share in cover, by its class crop


def excess_green(image_rgb: ByteArray | FloatArray) -> npt.NDArray[np.float64]:
    """Compute (2 G - R - B) / (R + G + B), -1 to 2, of (H, W, 3) (Woebbecke et al. 1995)."""
    red, green, blue = np.moveaxis(image_rgb.astype(np.float64), -1, 0)
    greenness: npt.NDArray[np.float64] = (2.0 * green - red - blue) / (red + green + blue + 1.0)
    return greenness


def level_green(green: FloatArray, class_id: ByteArray) -> FloatArray:
    """Measure the excess of green (H, W) over that of what a network calls soil.

    White balance colours soil and leaves alike.
    """
    sample, sample_id = (values[::SOIL_STEP, ::SOIL_STEP] for values in (green, class_id))
    soil = sample[sample_id == PlantClass.SOIL]
    if len(soil) < LEAST_SOIL_RATIO * sample.size:
        return green
    level = float(np.median(soil))
    return green - min(max(level, -MOST_SOIL_GREEN), MOST_SOIL_GREEN)


def measure_cover(green: FloatArray, class_id: ByteArray, confidence: ByteArray) -> FloatArray:
    """Measure how likely pixels (H, W) are plants, 0 to 1, and most of all crop.

    `green` is their excess of green. Greenness finds a crop that the network does not know, the
    network a crop in bad light.
    """
    sure = confidence / 255.0
    low, high = COVER_GREEN
    is_plant = class_id != PlantClass.SOIL
    is_crop = class_id == PlantClass.CROP
    plant = np.maximum(((green - low) / (high - low)).clip(0.0, 1.0), np.where(is_plant, sure, 0.0))
    crop = np.where(is_crop, sure, np.where(is_plant, 1.0 - sure, 0.0))
    cover: FloatArray = (1.0 - NETWORK_SHARE) * plant + NETWORK_SHARE * crop
    return cover
