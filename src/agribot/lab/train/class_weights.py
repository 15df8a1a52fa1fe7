"""Weights of the classes in the cross-entropy, computed from the labels that a training has."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.errors import ConfigError
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.train.evaluate import CLASS_NAMES

Counts = npt.NDArray[np.int64]
Weights = tuple[float, float, float]

AUTO = "auto"  # name of ROOT, which stays moderate where a class is very rare
ROOT, MEDIAN, INVERSE = "inverse-root", "median-frequency", "inverse-frequency"
WEIGHTINGS = (AUTO, ROOT, MEDIAN, INVERSE)


class ClassCounts(NamedTuple):
    """Pixels of weed, crop and soil, and the labelled pixels of the pictures that have each."""

    pixels: Counts
    beside: Counts

    @property
    def ratios(self) -> npt.NDArray[np.float64]:
        """Share of each class in all labelled pixels."""
        ratios: npt.NDArray[np.float64] = self.pixels / self.pixels.sum()
        return ratios


def count_classes(labels: Iterable[ByteArray]) -> ClassCounts:
    """Count the classes of labels (H, W); pixels without a class do not count."""
    pixels, beside = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for label in labels:
        counted = np.bincount(label.ravel(), minlength=256)[: len(PlantClass)]
        pixels += counted
        beside += np.where(counted > 0, counted.sum(), 0)
    return ClassCounts(pixels, beside)


def compute_weights(counts: ClassCounts, weighting: str) -> Weights:
    """Compute the weights of weed, crop and soil, to four digits.

    `inverse-frequency`: 1 / share of all pixels, `inverse-root`: its square root; both with a mean
    of 1. `median-frequency`: median of the shares over the share, each in the pictures that have
    the class (Eigen and Fergus 2015).

    Raises: ConfigError: a class that no pixel has.
    """
    missing = [name for name, count in zip(CLASS_NAMES, counts.pixels, strict=True) if not count]
    if missing:
        raise ConfigError(
            f"--class-weights {weighting}: no pixel of the pictures to train on is "
            f"{' or '.join(missing)}; give numbers, such as 1,2,0.6"
        )
    if weighting == MEDIAN:
        share = counts.pixels / counts.beside
        weights = np.median(share) / share
    else:
        weights = 1.0 / (counts.ratios if weighting == INVERSE else np.sqrt(counts.ratios))
        weights /= weights.mean()
    weed, crop, soil = (float(f"{weight:.4g}") for weight in weights)
    return weed, crop, soil


def describe_weights(counts: ClassCounts, weights: Weights, weighting: str) -> str:
    """Say in one line which weights come from which shares of the pixels."""
    parts = ", ".join(
        f"{name} {weight:g} (of {ratio:.2%} of the pixels)"
        for name, weight, ratio in zip(CLASS_NAMES, weights, counts.ratios, strict=True)
    )
    return f"class weights, {weighting}: {parts}"
