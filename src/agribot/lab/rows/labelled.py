"""Photographs with a drawing of their crop rows: white lines on black, of any size.

All is measured at one size, so that figures of different cameras can be compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageFilter

from agribot.autonomy.perceive.pictures import PictureClasses
from agribot.autonomy.perceive.plant_cover import excess_green
from agribot.core.messages import ByteArray
from agribot.lab.dataset.pictures import PictureError, read_picture, resize_nearest

Mask = npt.NDArray[np.bool_]

SIDE_PX = 512  # width and height of the pictures that are judged
TOP_PX = round(0.3 * SIDE_PX)  # rows above, whose plants are too far away and are not judged
LEAST_GREEN = 0.10  # excess green of chromatic coordinates, of plants
LINE_LEVEL = 127  # brightness of 255, of background
ON_ROW_PX = 6  # distance from a labelled line, of plants on a row
LEAST_GAP_PX = 60  # width between two lines, of rows with a space between them
MARGIN_RATIO = 0.36  # share of a gap on either side of its middle 28 %
JOIN_PX = 8  # widest hole in a line that one picture row crosses
MOST_WHITE_RATIO = 0.5  # share of a drawing that lines can cover
# Tolerance between the width to height ratios of a photograph and its drawing.
SHAPE_TOLERANCE = 0.02


class RowPhoto(NamedTuple):
    """A photograph (SIDE_PX, SIDE_PX, 3) and its lines (SIDE_PX, SIDE_PX)."""

    image_rgb: ByteArray
    lines: Mask


class Regions(NamedTuple):
    """Plant pixels of a picture, (SIDE_PX, SIDE_PX) each: on a row, and between two rows."""

    on_rows: Mask
    between_rows: Mask


def read_lines(path: Path, picture_shape: tuple[int, ...] | None = None) -> Mask:
    """Read a drawing of rows (SIDE_PX, SIDE_PX), of a photograph of (height, width, ...) pixels.

    Raises: PictureError: it cannot be read, shows no line, or does not fit the photograph.
    """
    drawn = read_picture(path)
    if picture_shape is not None:
        _check_shape(path, drawn.shape, picture_shape)
    grey = Image.fromarray(drawn.max(axis=2)).resize((SIDE_PX, SIDE_PX), Image.Resampling.BILINEAR)
    lines: Mask = np.asarray(grey) > LINE_LEVEL
    white_ratio = float(lines.mean())
    if not white_ratio:
        raise PictureError(
            f"{path}: shows no line, no pixel is brighter than {LINE_LEVEL} of 255; draw the "
            "rows white on black"
        )
    if white_ratio > MOST_WHITE_RATIO:
        raise PictureError(
            f"{path}: is white over {white_ratio:.0%}, lines cover {MOST_WHITE_RATIO:.0%} at "
            "most; draw the rows white on black"
        )
    return lines


def _check_shape(path: Path, drawn: tuple[int, ...], picture: tuple[int, ...]) -> None:
    ratio = (drawn[1] / drawn[0]) / (picture[1] / picture[0])
    if abs(ratio - 1.0) > SHAPE_TOLERANCE:
        raise PictureError(
            f"{path}: is {drawn[1]} x {drawn[0]} pixels, its photograph {picture[1]} x "
            f"{picture[0]}, another ratio of width to height; draw the rows over the whole "
            "photograph"
        )


def fit_picture(image_rgb: ByteArray) -> ByteArray:
    """Resize a photograph (H, W, 3) to the size that is judged."""
    if image_rgb.shape[:2] == (SIDE_PX, SIDE_PX):
        return image_rgb
    picture = Image.fromarray(image_rgb)
    return np.asarray(picture.resize((SIDE_PX, SIDE_PX), Image.Resampling.BILINEAR))


def fit_classes(classes: PictureClasses) -> PictureClasses:
    """Resize the classes (H, W) of a photograph to the size that is judged."""
    shape = (SIDE_PX, SIDE_PX)
    return PictureClasses(*(resize_nearest(values, shape) for values in classes))


def find_regions(picture: RowPhoto) -> Regions:
    """Find the plants whose class follows from the lines."""
    is_plant = excess_green(picture.image_rgb) > LEAST_GREEN
    is_plant[:TOP_PX] = False
    white = Image.fromarray(np.where(picture.lines, 255, 0).astype(np.uint8))
    near = np.asarray(white.filter(ImageFilter.MaxFilter(2 * ON_ROW_PX + 1))) > 0
    return Regions(is_plant & near, is_plant & find_gaps(picture.lines))


def find_gaps(lines: Mask, top_px: int = TOP_PX) -> Mask:
    """Find the middle of the space between neighbouring lines, below a picture row."""
    between = np.zeros(lines.shape, dtype=bool)
    for v_px in range(top_px, len(lines)):
        centres = [(first + last) / 2.0 for first, last in find_crossings(lines[v_px])]
        for left, right in pairwise(centres):
            margin_px = MARGIN_RATIO * (right - left)
            if right - left > LEAST_GAP_PX:
                between[v_px, int(left + margin_px) : int(right - margin_px)] = True
    return between


def find_crossings(row: Mask) -> Iterator[tuple[int, int]]:
    """Find where lines cross a picture row (W,): the first and the last column of each."""
    white = np.flatnonzero(row)
    if len(white):
        for run in np.split(white, np.flatnonzero(np.diff(white) > JOIN_PX) + 1):
            yield int(run[0]), int(run[-1])
