"""Scores of a class map: every number from one confusion matrix over all pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass

CLASS_NAMES = tuple(c.name.lower() for c in PlantClass)
Confusion = npt.NDArray[np.int64]
ByClass = dict[str, float | None]


class Scores(msgspec.Struct, frozen=True, kw_only=True):
    """Per-class scores by class name; `confusion[truth][guess]` counts pixels.

    A class that does not occur has no score: None, and is left out of `miou`.
    """

    images: int
    iou: ByClass
    miou: float
    precision: ByClass
    recall: ByClass
    f1: ByClass
    confusion: list[list[int]]


def count_confusion(truth: ByteArray, guess: ByteArray) -> Confusion:
    """Count pixels (3, 3), rows the truth; pixels whose truth is no class do not count."""
    counted = truth < len(PlantClass)
    pairs = truth[counted].astype(np.int64) * len(PlantClass) + guess[counted]
    shape = (len(PlantClass), len(PlantClass))
    return np.bincount(pairs, minlength=shape[0] * shape[1]).reshape(shape)


def compute_scores(confusion: Confusion, images: int) -> Scores:
    """Score a confusion matrix (3, 3) over a number of images."""
    hits = np.diag(confusion).astype(np.float64)
    truth, guess = confusion.sum(axis=1), confusion.sum(axis=0)
    with np.errstate(invalid="ignore"):
        iou = hits / (truth + guess - hits)
        return Scores(
            images=images,
            iou=_name_classes(iou),
            miou=float(np.nanmean(iou)),
            precision=_name_classes(hits / guess),
            recall=_name_classes(hits / truth),
            f1=_name_classes(2.0 * hits / (truth + guess)),
            confusion=confusion.tolist(),
        )


def evaluate(
    classify: Callable[[ByteArray], ByteArray], pairs: Iterable[tuple[ByteArray, ByteArray]]
) -> Scores:
    """Pool (image_rgb, truth) pairs; `classify` answers at the resolution of the image.

    Raises: ConfigError: there is no pair.
    """
    confusion = np.zeros((len(PlantClass), len(PlantClass)), dtype=np.int64)
    images = 0
    for image_rgb, truth in pairs:
        confusion += count_confusion(truth, classify(image_rgb))
        images += 1
    if not images:
        raise ConfigError("no labelled picture to judge on can be read; see agribot dataset check")
    return compute_scores(confusion, images)


def _name_classes(values: npt.NDArray[np.float64]) -> ByClass:
    return {
        name: None if np.isnan(value) else float(value)
        for name, value in zip(CLASS_NAMES, values, strict=True)
    }
