"""Superpixels: pieces of one colour whose outlines follow leaves, to be labelled at one click."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageFilter

from agribot.core.messages import ByteArray

Floats = npt.NDArray[np.float32]
MOST_PX = 800_000  # size beyond which the picture is reduced
MOST_PIECES = 60_000  # numbers of 16 bits
ROUNDS = 4
# Size of the median: noise of a pixel makes no piece of its own, and edges stay sharp.
MEDIAN_PX = 3
# Levels of colour that count as much as a piece's own width away from its centre.
COMPACTNESS = 20.0
COLOUR_WEIGHTS = (0.7, 2.0, 0.6)  # light, excess of green, red against blue


def find_superpixels(image_rgb: ByteArray, width_px: float = 14.0) -> npt.NDArray[np.uint16]:
    """Find the number of the piece of every pixel, (h, w) of the picture or a smaller copy.

    SLIC (Achanta et al., TPAMI 2012) with the grid search of gSLIC (Ren and Reid 2011): a pixel
    belongs to one of the nine pieces around the cell of the grid in which it lies. Colour is
    light, excess of green and red against blue, in which plants and soil lie apart.
    """
    small = _shrink(image_rgb)
    height, width = small.shape[:2]
    step_px = max(width_px, float(np.sqrt(height * width / MOST_PIECES)))
    rows, columns = max(1, round(height / step_px)), max(1, round(width / step_px))
    down, right = np.mgrid[0:height, 0:width].astype(np.float32)
    cell = (
        np.minimum((down * rows / height).astype(np.intp), rows - 1),
        np.minimum((right * columns / width).astype(np.intp), columns - 1),
    )
    weight = COMPACTNESS / step_px
    features = np.concatenate(
        [_opponent(small), (weight * down)[..., None], (weight * right)[..., None]], axis=2
    )
    piece = cell[0] * columns + cell[1]
    for _ in range(ROUNDS):
        centres = _average(features, piece, rows * columns)
        piece = _assign(features, centres, cell, (rows, columns))
    numbers: npt.NDArray[np.uint16] = piece.astype(np.uint16)
    return numbers


def _shrink(image_rgb: ByteArray) -> ByteArray:
    height, width = image_rgb.shape[:2]
    scale = min(1.0, float(np.sqrt(MOST_PX / (height * width))))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = Image.fromarray(image_rgb).resize(size, Image.Resampling.BILINEAR)
    return np.asarray(small.filter(ImageFilter.MedianFilter(MEDIAN_PX)))


def _opponent(image_rgb: ByteArray) -> Floats:
    red, green, blue = np.moveaxis(image_rgb.astype(np.float32), -1, 0)
    axes = ((red + green + blue) / 3.0, (2.0 * green - red - blue) / 2.0, (red - blue) / 2.0)
    weighted = [weight * axis for weight, axis in zip(COLOUR_WEIGHTS, axes, strict=True)]
    return np.stack(weighted, axis=2).astype(np.float32)


def _average(features: Floats, piece: npt.NDArray[np.intp], count: int) -> Floats:
    numbers = piece.ravel()
    sizes = np.maximum(np.bincount(numbers, minlength=count), 1)
    sums = [np.bincount(numbers, features[..., i].ravel(), count) for i in range(features.shape[2])]
    return (np.stack(sums, axis=1) / sizes[:, None]).astype(np.float32)


def _assign(
    features: Floats,
    centres: Floats,
    cell: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]],
    grid: tuple[int, int],
) -> npt.NDArray[np.intp]:
    rows, columns = grid
    best = np.full(features.shape[:2], np.inf, np.float32)
    winner = np.zeros(features.shape[:2], np.intp)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            row = (cell[0] + down).clip(0, rows - 1)
            column = (cell[1] + right).clip(0, columns - 1)
            number = row * columns + column
            distance = ((features - centres[number]) ** 2).sum(axis=2)
            is_nearer = distance < best
            best[is_nearer] = distance[is_nearer]
            winner[is_nearer] = number[is_nearer]
    return winner
