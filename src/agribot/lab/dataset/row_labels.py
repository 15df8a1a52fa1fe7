"""The row as teacher: pictures of a drive along rows, labelled by where the plants stand.

What grows on a row is crop, what grows between the rows is weed; where this is ambiguous, or no
row is found, pixels stay unlabelled. So a network learns an unknown crop without masks painted by
hand. The labels are for training, never for evaluation: a weed in a row is taken for crop, unless
it is much smaller than its neighbours.
Source: Lottes and Stachniss 2017 (IROS); Bah et al. 2018 (Remote Sensing 10).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.autonomy.perceive.ground import GroundLookup
from agribot.autonomy.perceive.plant_cover import excess_green
from agribot.autonomy.perceive.row_line import find_row_line, locate_foliage
from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass, RowLine
from agribot.core.pose import Pose2
from agribot.lab.dataset.classes import UNLABELLED

Mask = npt.NDArray[np.bool_]
Green = npt.NDArray[np.float32]  # excess of green of pixels (H, W)

# Distance beyond which a pixel covers more than a small leaf.
FAR_M = 1.8
# The robot follows the row of a picture that is taken; in a turn it looks across rows.
MOST_OFFSET_M, MOST_HEADING_RAD = 0.25, math.radians(12.0)
# Plants are what is greener than this, whatever the light: soil reaches 0.05, residue 0.1. Where
# the pictures themselves part plants from soil elsewhere, they are believed between these limits.
LEAST_GREEN, MOST_GREEN = 0.08, 0.3
UNSURE_GREEN = 0.03  # distance from the threshold within which a pixel is of nothing
LEAST_PX = 12  # least size of a piece; a smaller one is noise
THICKEN_PX = 9
# Profile across the row: width of its cells, their number, and the part of its height above the
# growth between the rows at which the row ends.
CELL_M, PROFILE_CELLS, EDGE_RATIO = 0.01, 35, 0.25
LEAST_CONTRAST = 2.0  # contrast of the cover on the row over that between the rows
HALF_ROW_M = (0.03, 0.2)  # limits of a row's half width by a profile
LEAVES_RATIO = 1.6  # reach of the row's leaves from its line, in half widths
CLEAR_M = 0.03  # clearance of a weed beyond that reach
# Factor for the next row: its leaves are seen at a slant, and its line is not found.
NEXT_ROW_RATIO = 1.5
LEAST_IN_ROW = 0.7  # share of a piece in the row; a weed that reaches into the row has less
LEAST_SHARE = 1.0 / 6.0  # share of the median size on a row; a smaller piece may be a weed in it


class RowPicture(NamedTuple):
    """A picture along a row: how green its pixels are, and how far from the line they stand.

    `green` (H, W) is the excess of green; `left_m` (H, W) how far left of the row's line the plant
    stands that a pixel shows, NaN where it is too far off.
    """

    green: Green
    left_m: npt.NDArray[np.float32]


class RowLabeller:
    """Labels the pictures of one camera on one robot, by how green their pixels are.

    Find the line of each, `place` its pixels, and `label` it when all of them are known.
    `pitch_m` is how far the next row is; where it is not known, only what stands near the row of
    the robot can be labelled.
    """

    def __init__(self, ground: GroundLookup, pitch_m: float | None = None) -> None:
        self._ground = ground
        self._far_m = PROFILE_CELLS * CELL_M if pitch_m is None else pitch_m
        self._is_near = (ground.range_m <= FAR_M) & (ground.area_m2 > 0.0)
        self._place_m = locate_foliage(ground, self._is_near)

    def find_line(self, green: Green, threshold: float) -> RowLine | None:
        """Find the row in a picture; None where it shows none that the robot follows."""
        # Thin leaves, as onions have, cover too little ground for a line that is found by cover.
        is_plant = ndimage.maximum_filter(green, THICKEN_PX) > threshold
        class_id = np.where(is_plant, PlantClass.CROP, PlantClass.SOIL).astype(np.uint8)
        everywhere = np.full(class_id.shape, 255, dtype=np.uint8)
        plants = ClassMap(class_id=class_id, confidence=everywhere, scale_px=(1.0, 1.0))
        line = find_row_line(plants, self._ground, 0.0)
        if line is None or line.offset_m is None or line.heading_rad is None:
            return None
        if abs(line.offset_m) > MOST_OFFSET_M or abs(line.heading_rad) > MOST_HEADING_RAD:
            return None
        return line

    def place(self, green: Green, line: RowLine) -> RowPicture:
        """Say of the pixels how far from a line of `find_line` their plants stand."""
        assert line.offset_m is not None and line.heading_rad is not None
        seen_from = Pose2(line.at_ahead_m, 0.0, -line.heading_rad)
        left_m = np.full(green.shape, np.nan, dtype=np.float32)
        left_m[self._is_near] = seen_from.locate(*self._place_m)[1] + line.offset_m
        return RowPicture(green, left_m)

    def label(self, picture: RowPicture, threshold: float, half_row_m: float) -> ByteArray:
        """Label the pixels (H, W): a PlantClass, or UNLABELLED where ambiguous."""
        is_plant = picture.green > threshold
        is_near = np.isfinite(picture.left_m)
        label = np.full(is_plant.shape, UNLABELLED, dtype=np.uint8)
        label[is_near & (picture.green < threshold - UNSURE_GREEN)] = PlantClass.SOIL
        pieces, count = ndimage.label(is_plant & is_near, np.ones((3, 3)))
        if not count:
            return label
        numbers = np.arange(1, count + 1)
        off_m = np.abs(np.where(is_near, picture.left_m, np.inf))
        nearest_m = np.asarray(ndimage.minimum(off_m, pieces, numbers))
        farthest_m = np.asarray(ndimage.maximum(off_m, pieces, numbers))
        size_px = np.bincount(pieces.ravel(), minlength=count + 1)[1:]
        area_m2 = np.asarray(ndimage.sum(self._ground.area_m2, pieces, numbers))
        reach_m = LEAVES_RATIO * half_row_m
        is_big = size_px >= LEAST_PX
        in_reach = np.asarray(ndimage.mean(off_m <= reach_m, pieces, numbers))
        on_row = is_big & (nearest_m <= half_row_m / 2.0) & (in_reach >= LEAST_IN_ROW)
        if on_row.any():
            on_row &= area_m2 >= LEAST_SHARE * float(np.median(area_m2[on_row]))
        between = is_big & (nearest_m > reach_m + CLEAR_M)
        between &= farthest_m < self._far_m - NEXT_ROW_RATIO * reach_m
        is_sure = is_plant & (picture.green > threshold + UNSURE_GREEN)
        crop = _choose(on_row)[pieces] & (off_m <= reach_m)
        label[is_sure & crop] = PlantClass.CROP
        label[is_sure & _choose(between)[pieces]] = PlantClass.WEED
        return label


class GreenHistogram:
    """Histogram of greenness over many pictures: `add` each, then ask for the `threshold`."""

    def __init__(self) -> None:
        self._edges = np.linspace(-0.5, 1.0, 257)
        self._counts = np.zeros(256)

    def add(self, green: Green) -> None:
        self._counts += np.histogram(green[::4, ::4], self._edges)[0]

    def find_threshold(self) -> float:
        """Find the excess of green that parts plants from soil best (Otsu 1979)."""
        counts, middles = self._counts, (self._edges[:-1] + self._edges[1:]) / 2.0
        below, sums = np.cumsum(counts), np.cumsum(counts * middles)
        above, rest = below[-1] - below, sums[-1] - sums
        parted = below * above * (sums / np.maximum(below, 1) - rest / np.maximum(above, 1)) ** 2
        return float(np.clip(self._edges[int(parted.argmax()) + 1], LEAST_GREEN, MOST_GREEN))


class RowProfile:
    """Profile across the row, over many pictures: `add` each, then ask for `half_row_m`."""

    def __init__(self) -> None:
        self._grown, self._shown = np.zeros(PROFILE_CELLS), np.zeros(PROFILE_CELLS)

    def add(self, picture: RowPicture, threshold: float) -> None:
        off_m = np.abs(picture.left_m)
        near = off_m < PROFILE_CELLS * CELL_M
        cell = np.minimum((off_m[near] / CELL_M).astype(np.int64), PROFILE_CELLS - 1)
        self._grown += np.bincount(cell, picture.green[near] > threshold, PROFILE_CELLS)
        self._shown += np.bincount(cell, minlength=PROFILE_CELLS)

    def find_half_row_m(self) -> float:
        """Find how far from its line the plants of the row stand.

        Raises: ConfigError: plants grow between the rows as they do on them.
        """
        covered = ndimage.uniform_filter1d(self._grown / np.maximum(self._shown, 1.0), 3)
        between, top = float(np.median(covered[2 * PROFILE_CELLS // 3 :])), float(covered.max())
        if top < LEAST_CONTRAST * between:
            raise ConfigError(
                f"plants cover {top:.0%} of the ground on the rows and {between:.0%} of that "
                f"between them, which is not {LEAST_CONTRAST:g} times less: these rows cannot "
                "teach; label some pictures by hand (agribot label)"
            )
        edge = between + EDGE_RATIO * (top - between)
        is_beyond = (covered <= edge) & (np.arange(PROFILE_CELLS) > covered.argmax())
        half_m = float(is_beyond.argmax()) * CELL_M if is_beyond.any() else math.inf
        return min(max(half_m, HALF_ROW_M[0]), HALF_ROW_M[1])


def measure_green(image_rgb: ByteArray) -> Green:
    """Measure the excess of green, pixel by pixel: smoothed, leaves would grow over the soil."""
    return excess_green(image_rgb).astype(np.float32)


def _choose(chosen: Mask) -> Mask:
    """Make a table of piece numbers; 0 is no piece."""
    return np.concatenate([[False], chosen])
