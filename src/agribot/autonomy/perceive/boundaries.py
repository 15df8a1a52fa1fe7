"""How well the outlines of the classes match, which the IoU of large areas does not show."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from agribot.core.messages import ByteArray, PlantClass

# Tolerance of an outline, as a share of the picture's diagonal. Source: Csurka et al. 2013.
TOLERANCE_RATIO = 0.0075

Mask = npt.NDArray[np.bool_]
Counts = npt.NDArray[np.int64]


def boundary_counts(truth: ByteArray, guess: ByteArray) -> Counts:
    """Count outline pixels of each class, (3, 4).

    The columns are outline pixels of the guess and how many of them lie on one of the truth, then
    outline pixels of the truth and how many of them lie on one of the guess.

    `truth` and `guess` are class maps (height, width); where the truth is no class, nothing counts.
    Two outlines that are nearer than 0.75 % of the diagonal lie on each other.
    """
    ignored = truth >= len(PlantClass)
    tolerance_px = TOLERANCE_RATIO * math.hypot(*truth.shape)
    counts = np.zeros((len(PlantClass), 4), dtype=np.int64)
    for kind in PlantClass:
        said, true = (_outline(one == kind, ignored) for one in (guess, truth))
        counts[kind] = (
            len(said), _near(said, true, tolerance_px), len(true), _near(true, said, tolerance_px),
        )  # fmt: skip
    return counts


def boundary_f1(counts: Counts) -> list[float | None]:
    """Score of each class of summed `boundary_counts`; None where it has no outline at all."""
    scores: list[float | None] = []
    for said, said_right, true, true_met in counts.tolist():
        precision, recall = said_right / max(1, said), true_met / max(1, true)
        both = precision + recall
        scores.append(None if not said + true else 2.0 * precision * recall / both if both else 0.0)
    return scores


def _outline(mask: Mask, ignored: Mask) -> npt.NDArray[np.int64]:
    """(N, 2) row and column of the pixels with a neighbour of another class beside them.

    Neither the edge of the picture nor that of an ignored region is an outline.
    """
    whole = np.pad(mask | ignored, 1, constant_values=True)
    inside = whole[1:-1, 1:-1] & whole[:-2, 1:-1] & whole[2:, 1:-1]
    inside &= whole[1:-1, :-2] & whole[1:-1, 2:]
    return np.argwhere(mask & ~ignored & ~inside)


def _near(pixels: npt.NDArray[np.int64], others: npt.NDArray[np.int64], tolerance_px: float) -> int:
    """Count the pixels (N, 2) with one of the others nearer than the tolerance.

    In each row that a circle reaches, running sums show whether its chord holds another one.
    """
    if not len(pixels) or not len(others):
        return 0
    height, width = np.maximum(pixels.max(axis=0), others.max(axis=0)) + 1
    sums = np.zeros((height, width + 1), dtype=np.int64)
    sums[others[:, 0], others[:, 1] + 1] = 1
    np.cumsum(sums, axis=1, out=sums)
    is_near = np.zeros(len(pixels), dtype=bool)
    reach_px = math.ceil(tolerance_px) - 1
    for down in range(-reach_px, reach_px + 1):
        aside_px = math.ceil(math.sqrt(tolerance_px**2 - down**2)) - 1
        row = pixels[:, 0] + down
        inside = (row >= 0) & (row < height)
        left = np.maximum(pixels[:, 1] - aside_px, 0)[inside]
        right = np.minimum(pixels[:, 1] + aside_px + 1, width)[inside]
        is_near[inside] |= sums[row[inside], right] > sums[row[inside], left]
    return int(is_near.sum())
