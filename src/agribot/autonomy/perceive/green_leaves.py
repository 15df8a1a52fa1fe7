"""Leaves that a network calls soil, by the colour of the plants that it finds in the same picture.

In light that it does not know, a network misses parts of leaves. Where it is not sure of the soil,
and the pixel is nearer in greenness to the picture's plants than to its soil, a plant stands there.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.plant_cover import excess_green
from agribot.core.messages import ByteArray, FloatArray, PlantClass

Mask = npt.NDArray[np.bool_]

MOST_SURE = 0.9  # probability of soil above which the network is believed
# Least plants and soil in a sample, and how much greener plants have to be: in near infrared and
# at night they are not.
LEAST_SAMPLES, LEAST_GREENER = 30, 0.04
STEP = 7  # pixels from one of the sample to the next, down and across


def find_green_leaves(class_map: ClassMap, image_rgb: ByteArray) -> Mask:
    """Find the pixels (h, w) of a map that its picture (H, W, 3) shows to be leaves, not soil."""
    is_soil = class_map.class_id == PlantClass.SOIL
    found = np.zeros(is_soil.shape, dtype=np.bool_)
    limit = _find_limit(class_map, image_rgb)
    if limit is not None:
        doubtful = np.nonzero(is_soil & (class_map.confidence <= MOST_SURE * 255.0))
        found[doubtful] = _measure_green(image_rgb, is_soil.shape, *doubtful) > limit
    return found


def _find_limit(class_map: ClassMap, image_rgb: ByteArray) -> float | None:
    """Find the middle between the greenness of soil and of plants; None: they are alike."""
    shape = class_map.class_id.shape
    rows, columns = (grid.ravel() for grid in np.mgrid[: shape[0] : STEP, : shape[1] : STEP])
    green = _measure_green(image_rgb, shape, rows, columns)
    is_soil = class_map.class_id[rows, columns] == PlantClass.SOIL
    if min(is_soil.sum(), (~is_soil).sum()) < LEAST_SAMPLES:
        return None
    soil, plant = float(np.median(green[is_soil])), float(np.median(green[~is_soil]))
    return (soil + plant) / 2.0 if plant - soil >= LEAST_GREENER else None


def _measure_green(
    image_rgb: ByteArray,
    shape: tuple[int, ...],
    rows: npt.NDArray[np.intp],
    columns: npt.NDArray[np.intp],
) -> FloatArray:
    """Measure the excess of green (N,) of pixels of a map (h, w) in its picture."""
    at = (
        (2 * index + 1) * size // (2 * count)
        for index, size, count in zip((rows, columns), image_rgb.shape[:2], shape, strict=True)
    )
    green: FloatArray = excess_green(image_rgb[*at])
    return green
