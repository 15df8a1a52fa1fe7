"""Plants in a picture: connected pixels of one class."""

from __future__ import annotations

import msgspec
import numpy as np

from agribot.autonomy.perceive.pieces import find_windows, label_pieces
from agribot.core.messages import ByteArray, PlantClass

# Least share of a true plant that is vegetation of its class in the picture.
MISSED_RATIO = 0.25


class PicturePlant(msgspec.Struct, frozen=True, kw_only=True):
    """`u_px`, `v_px` is the mean place of its pixels: right and down from the top left pixel."""

    plant: PlantClass
    u_px: float
    v_px: float
    area_px: int
    confidence: float
    left_px: int
    top_px: int
    width_px: int
    height_px: int


def plants_in(class_id: ByteArray, confidence: ByteArray, least_px: int) -> list[PicturePlant]:
    """Cut a class map (H, W) into plants of at least `least_px` pixels, weeds first."""
    found = []
    for kind in (PlantClass.WEED, PlantClass.CROP):
        labels, count = label_pieces(class_id == kind)
        if not count:
            continue
        sizes = np.bincount(labels.ravel())
        for label, window in enumerate(find_windows(labels, count), 1):
            if window is None or sizes[label] < least_px:
                continue
            piece = labels[window] == label
            rows, columns = np.nonzero(piece)
            down, right = window
            found.append(
                PicturePlant(
                    plant=kind,
                    u_px=float(columns.mean()) + right.start,
                    v_px=float(rows.mean()) + down.start,
                    area_px=int(sizes[label]),
                    confidence=float(confidence[window][piece].mean()) / 255.0,
                    left_px=right.start,
                    top_px=down.start,
                    width_px=right.stop - right.start,
                    height_px=down.stop - down.start,
                )
            )
    return found


class PlantRecall(msgspec.Struct, frozen=True, kw_only=True):
    """Shares of the true plants of one class: called right, called the other class, not seen."""

    right: int
    confused: int
    missed: int


def plant_recall(truth: ByteArray, guess: ByteArray, least_px: int) -> dict[str, PlantRecall]:
    """Count how true plants were classed; each has the class that most of it is given.

    `truth` and `guess` are class maps (H, W); plants below `least_px` pixels do not count.
    """
    recalls = {}
    for kind in (PlantClass.WEED, PlantClass.CROP):
        labels, count = label_pieces(truth == kind)
        inside = labels > 0
        pairs = labels[inside] * len(PlantClass) + guess[inside]
        by_class = np.bincount(pairs, minlength=(count + 1) * len(PlantClass))
        by_class = by_class.reshape(count + 1, len(PlantClass))[1:]
        by_class = by_class[by_class.sum(axis=1) >= least_px]
        seen = by_class[:, :2].sum(axis=1) >= MISSED_RATIO * by_class.sum(axis=1)
        right = seen & (by_class[:, :2].argmax(axis=1) == kind)
        recalls[kind.name.lower()] = PlantRecall(
            right=int(right.sum()), confused=int((seen & ~right).sum()), missed=int((~seen).sum())
        )
    return recalls
