"""Class maps of whole pictures: of any size and shape, at the picture's own resolution."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.class_map import ClassMap
from agribot.core.errors import PerceptionError
from agribot.core.messages import ByteArray, PlantClass

Floats = npt.NDArray[np.float32]

# A picture whose shape is this near to the network's is stretched; another one is padded.
SHAPE_TOLERANCE = 0.1
OVERLAP_RATIO = 0.25


class Classifier(Protocol):
    map_shape: tuple[int, int]

    def segment(self, image_rgb: ByteArray) -> ClassMap:
        """Classify a picture (H, W, 3)."""


class PictureClasses(NamedTuple):
    """`PlantClass` of every pixel, and its probability with 255 = certain; both (height, width)."""

    class_id: ByteArray
    confidence: ByteArray


class SeenPicture(NamedTuple):
    """A picture with what the network says of it, whose class map shows it from the top left.

    `scale_px` are the rows and columns of the picture over those of the map.
    """

    classes: PictureClasses
    class_map: ClassMap
    scale_px: tuple[float, float]


def classify(
    classifier: Classifier, image_rgb: ByteArray, tile_px: tuple[int, int] | None = None
) -> PictureClasses:
    """Classify a picture as one, or in overlapping tiles of (height, width) pixels.

    Tiles suit a large picture of many small plants, such as an orthophoto: take the size at
    which a tile shows what a training picture showed.
    """
    if tile_px is None:
        return _one_tile(classifier, image_rgb)
    if min(tile_px) < 8:
        raise PerceptionError(f"tiles of {tile_px} pixels are too small; give at least 8 x 8")
    height, width = image_rgb.shape[:2]
    class_id = np.full((height, width), PlantClass.SOIL, np.uint8)
    confidence = np.zeros((height, width), np.uint8)
    for window, inner in _tiles((height, width), tile_px):
        part = _one_tile(classifier, image_rgb[window])
        rows, columns = (
            slice(i.start - w.start, i.stop - w.start) for i, w in zip(inner, window, strict=True)
        )
        class_id[inner] = part.class_id[rows, columns]
        confidence[inner] = part.confidence[rows, columns]
    return PictureClasses(class_id, confidence)


Window = tuple[slice, slice]


def _tiles(shape: tuple[int, int], tile_px: tuple[int, int]) -> Iterator[tuple[Window, Window]]:
    """Windows to look at, and the part of each that is kept: its middle, away from its edges."""
    rows, columns = (_spans(size, tile) for size, tile in zip(shape, tile_px, strict=True))
    for row, inner_row in rows:
        for column, inner_column in columns:
            yield (row, column), (inner_row, inner_column)


def _spans(size_px: int, tile_px: int) -> list[tuple[slice, slice]]:
    tile_px = min(tile_px, size_px)
    step_px = max(1, round(tile_px * (1.0 - OVERLAP_RATIO)))
    starts = list(range(0, max(1, size_px - tile_px), step_px))
    if starts[-1] + tile_px < size_px:
        starts.append(size_px - tile_px)
    # The border between two windows lies in the middle of what both see.
    cuts = [0]
    cuts += [(b + a + tile_px) // 2 for a, b in itertools.pairwise(starts)]
    cuts.append(size_px)
    return [
        (slice(start, start + tile_px), slice(cuts[i], cuts[i + 1]))
        for i, start in enumerate(starts)
    ]


def _one_tile(classifier: Classifier, image_rgb: ByteArray) -> PictureClasses:
    return see_picture(classifier, image_rgb).classes


def see_picture(classifier: Classifier, image_rgb: ByteArray) -> SeenPicture:
    """Look at a picture (H, W, 3) as one, and keep all that the network says of it.

    Raises: PerceptionError: it has no pixels.
    """
    height, width = image_rgb.shape[:2]
    if not height or not width:
        raise PerceptionError(f"picture of {width} x {height} pixels is empty; check the camera")
    padded = _pad(_thin(image_rgb, classifier.map_shape), classifier.map_shape)
    seen = classifier.segment(padded)
    map_height, map_width = seen.class_id.shape
    small = _thin(image_rgb, classifier.map_shape).shape
    shown = (map_height * small[0] / padded.shape[0], map_width * small[1] / padded.shape[1])
    classes = enlarge(seen.class_id, seen.confidence, (height, width), shown)
    return SeenPicture(classes, seen, (height / shown[0], width / shown[1]))


def _thin(image_rgb: ByteArray, map_shape: tuple[int, int]) -> ByteArray:
    """Average a huge picture in blocks, still at least twice as fine as the network's input."""
    height, width = image_rgb.shape[:2]
    block = min(height // (2 * map_shape[0]), width // (2 * map_shape[1]))
    if block < 2:
        return image_rgb
    rows, columns = height // block, width // block
    total = np.zeros((rows, columns, 3), np.uint32)
    for down in range(block):
        for right in range(block):
            total += image_rgb[down : rows * block : block, right : columns * block : block]
    means: ByteArray = (total // (block * block)).astype(np.uint8)
    return means


def _pad(image_rgb: ByteArray, map_shape: tuple[int, int]) -> ByteArray:
    """Fit the picture into the network's shape without stretching; edges are repeated."""
    height, width = image_rgb.shape[:2]
    ratio = (width / height) / (map_shape[1] / map_shape[0])
    if abs(ratio - 1.0) <= SHAPE_TOLERANCE:
        return image_rgb
    down = max(0, round(width * map_shape[0] / map_shape[1]) - height)
    right = max(0, round(height * map_shape[1] / map_shape[0]) - width)
    # A strip of a few pixels has no shape to keep.
    if down > 50 * height or right > 50 * width:
        return image_rgb
    return np.pad(image_rgb, ((0, down), (0, right), (0, 0)), mode="edge")


def enlarge(
    class_id: ByteArray,
    confidence: ByteArray,
    shape: tuple[int, int],
    shown: tuple[float, float] | None = None,
) -> PictureClasses:
    """Enlarge a class map to another resolution, with the borders that its probabilities draw.

    `shown` is the (height, width) of the part of the map that the picture fills, from the top
    left. Probabilities are interpolated linearly: sharper than the nearest pixel's class.
    """
    shown = shown or (float(class_id.shape[0]), float(class_id.shape[1]))
    if class_id.shape == shape == shown:
        return PictureClasses(class_id, confidence)
    sure = confidence.astype(np.float32) / 255.0
    rest = (1.0 - sure) / (len(PlantClass) - 1)
    rows = _places(shape[0], shown[0], class_id.shape[0])
    columns = _places(shape[1], shown[1], class_id.shape[1])
    best = np.full(shape, -1.0, np.float32)
    winner = np.full(shape, PlantClass.SOIL, np.uint8)
    for kind in PlantClass:
        share = _interpolate(np.where(class_id == kind, sure, rest), rows, columns)
        better = share > best
        winner[better] = kind
        np.maximum(best, share, out=best)
    return PictureClasses(winner, np.round(255.0 * best.clip(0.0, 1.0)).astype(np.uint8))


class Places(NamedTuple):
    """For every row or column of the result, the two of the map beside it.

    `share` is that of the second.
    """

    first: npt.NDArray[np.intp]
    second: npt.NDArray[np.intp]
    share: Floats


def _places(size: int, shown: float, available: int) -> Places:
    centres = ((np.arange(size) + 0.5) * (shown / size) - 0.5).clip(0.0, available - 1.0)
    first = np.floor(centres).astype(np.intp)
    second = np.minimum(first + 1, available - 1)
    return Places(first, second, (centres - first).astype(np.float32))


def _interpolate(values: Floats, rows: Places, columns: Places) -> Floats:
    down = rows.share[:, None]
    tall = values[rows.first] * (1.0 - down) + values[rows.second] * down
    right = columns.share[None, :]
    wide: Floats = tall[:, columns.first] * (1.0 - right) + tall[:, columns.second] * right
    return wide
