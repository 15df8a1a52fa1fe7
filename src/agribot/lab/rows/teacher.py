"""Labels that teach, from photographs whose crop rows are drawn as lines.

Plants near a line are crop, plants in the middle of the space between two lines are weeds, and
all others teach nothing. A leaf of crop that reaches between the rows belongs to a piece of
vegetation mostly near a line, and teaches nothing either. The labels never judge.
Source: Lottes and Stachniss 2017 (IROS); Bah et al. 2018 (Remote Sensing 10).
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.plant_cover import excess_green
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.dataset.classes import UNLABELLED
from agribot.lab.dataset.pictures import resize_nearest
from agribot.lab.rows.labelled import SIDE_PX, Mask, find_gaps, fit_picture

FAR_PX = 80  # picture rows at the top whose plants are too small to teach
# Half width of a row, px: plants look larger further down the picture.
HALF_ROW_PX = 6.0 + 24.0 * np.arange(SIDE_PX)[:, None] / SIDE_PX
LEAST_GREEN, MOST_GREEN = 0.05, 0.14  # limits of the excess green that parts plants from soil
SMOOTH_PX, GREEN_RANGE = 1.0, (-0.1, 0.4)
CLOSE_PX = 9  # widest gap in foliage, such as a glossy spot, that is not called soil


def label_plants(image_rgb: ByteArray, lines: Mask) -> ByteArray:
    """Label the pixels (H, W) of a photograph with its lines (SIDE_PX, SIDE_PX).

    A label is a PlantClass, or UNLABELLED where the rows do not say what a pixel is.
    """
    is_plant = find_vegetation(fit_picture(image_rgb))
    from_line_px = cv2.distanceTransform((~lines).astype(np.uint8), cv2.DIST_L2, 5)
    crop = is_plant & (from_line_px < HALF_ROW_PX)
    weed = is_plant & find_gaps(lines, FAR_PX) & ~_find_leaves(is_plant, crop)
    label = np.full(is_plant.shape, PlantClass.SOIL, dtype=np.uint8)
    label[_close(is_plant)] = UNLABELLED
    label[weed] = PlantClass.WEED
    label[crop] = PlantClass.CROP
    label[:FAR_PX][is_plant[:FAR_PX]] = UNLABELLED
    return resize_nearest(label, image_rgb.shape[:2])


def find_vegetation(image_rgb: ByteArray) -> Mask:
    """Find plants (H, W) by their excess green, with the threshold of Otsu (1979)."""
    green = cv2.GaussianBlur(excess_green(image_rgb), (0, 0), SMOOTH_PX)
    low, high = GREEN_RANGE
    levels = np.clip((green - low) / (high - low) * 255.0, 0.0, 255.0).astype(np.uint8)
    level, _ = cv2.threshold(levels, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    threshold = low + (high - low) * level / 255.0
    found: Mask = np.asarray(green) > min(max(threshold, LEAST_GREEN), MOST_GREEN)
    return found


def _find_leaves(is_plant: Mask, crop: Mask) -> Mask:
    """Find the pieces of vegetation that are mostly crop."""
    count, pieces = cv2.connectedComponents(is_plant.astype(np.uint8))
    size: npt.NDArray[np.int64] = np.bincount(pieces.ravel(), minlength=count)
    in_row = np.bincount(pieces[crop], minlength=count)
    leaves: Mask = (2 * in_row > size)[pieces] & is_plant
    return leaves


def _close(is_plant: Mask) -> Mask:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (CLOSE_PX, CLOSE_PX))
    return np.asarray(cv2.morphologyEx(is_plant.astype(np.uint8), cv2.MORPH_CLOSE, disc)) > 0
