"""Judges masks of the network against the true ones, pixel by pixel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from agribot.core.messages import ByteArray, PlantClass


class MaskJudge:
    """Counts pixels by true and predicted class; call `add` with every mask, then `compute_iou`."""

    def __init__(self) -> None:
        self._confusion = np.zeros((3, 3), dtype=np.int64)

    @property
    def confusion(self) -> npt.NDArray[np.int64]:
        """Pixels of all masks, (3, 3): rows the true class, columns the network's."""
        return self._confusion.copy()

    def add(self, truth: ByteArray, class_id: ByteArray) -> None:
        """Add a predicted mask of any size, (h, w), against the true one, (H, W)."""
        predicted = _resize_nearest(class_id, truth.shape)
        pairs = truth.astype(np.int64) * 3 + predicted
        self._confusion += np.bincount(pairs.ravel(), minlength=9).reshape(3, 3)

    def restore(self, counts: Sequence[int]) -> None:
        """Add the counts of an earlier run, row by row."""
        self._confusion += np.array(counts, dtype=np.int64).reshape(3, 3)

    def compute_iou(self) -> dict[str, float | None]:
        """Return the IoU per class of all masks; None for a class that never occurred."""
        hit = np.diag(self._confusion)
        union = self._confusion.sum(0) + self._confusion.sum(1) - hit
        return {
            plant.name.lower(): float(hit[plant] / union[plant]) if union[plant] else None
            for plant in PlantClass
        }


def _resize_nearest(mask: ByteArray, shape: tuple[int, ...]) -> ByteArray:
    rows = (np.arange(shape[0]) + 0.5) * mask.shape[0] / shape[0]
    cols = (np.arange(shape[1]) + 0.5) * mask.shape[1] / shape[1]
    picked: ByteArray = mask[rows.astype(int)[:, None], cols.astype(int)[None]]
    return picked
