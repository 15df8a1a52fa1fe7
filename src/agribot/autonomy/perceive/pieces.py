"""Connected pieces of a mask, and the window of the picture that each of them fills."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]
Runs = npt.NDArray[np.int64]
Window = tuple[slice, slice]


def label_pieces(mask: Mask) -> tuple[Labels, int]:
    """Give the pieces of a mask (H, W) numbers from 1, by their first pixel, row by row.

    Pixels that touch at a corner belong together. Returns the number of each pixel, 0 outside, and
    how many pieces there are.

    Runs of a row are joined with those below them; a piece has the number of its first run.
    Source: He, Chao and Suzuki 2008, A run-based two-scan labeling algorithm.
    """
    labels = np.zeros(mask.shape, dtype=np.int32)
    stride = mask.shape[1] + 2  # a run at one edge must not touch the next row's other one
    padded = np.zeros((mask.shape[0], stride), dtype=bool)
    padded[:, 1:-1] = mask
    steps = np.flatnonzero(padded.ravel()[1:] != padded.ravel()[:-1]) + 1
    begins, ends = steps[::2], steps[1::2]
    if not len(begins):
        return labels, 0
    first_run = _join(*_find_touching(begins, ends, stride), len(begins))
    is_first = first_run == np.arange(len(begins))
    number = np.cumsum(is_first)[first_run]
    labels[mask] = np.repeat(number, ends - begins)
    return labels, int(is_first.sum())


def find_windows(labels: npt.NDArray[np.signedinteger], count: int) -> list[Window | None]:
    """Return the rows and columns that hold each piece from 1 to `count`; None where it is not."""
    height, width = labels.shape
    pixels = np.flatnonzero(labels)
    label_of = labels.ravel()[pixels]
    rows, columns = np.divmod(pixels, width)
    top, left = np.full(count + 1, height), np.full(count + 1, width)
    bottom, right = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    np.minimum.at(top, label_of, rows)
    np.minimum.at(left, label_of, columns)
    np.maximum.at(bottom, label_of, rows + 1)
    np.maximum.at(right, label_of, columns + 1)
    corners = np.stack([top, bottom, left, right], axis=1)[1:].tolist()
    return [(slice(a, b), slice(c, d)) if a < b else None for a, b, c, d in corners]


def _find_touching(begins: Runs, ends: Runs, stride: int) -> tuple[Runs, Runs]:
    """Pair each run with those in the row below that it touches, as numbers of runs."""
    first = np.searchsorted(ends, begins + stride)
    past = np.searchsorted(begins, ends + stride, side="right")
    counts = np.maximum(past - first, 0)
    upper = np.repeat(np.arange(len(begins)), counts)
    before = np.cumsum(counts) - counts
    lower = np.arange(len(upper)) - np.repeat(before - first, counts)
    return upper, lower


def _join(upper: Runs, lower: Runs, count: int) -> Runs:
    """Return for each run the first one of its piece."""
    first = np.arange(count)
    while True:
        one, other = first[upper], first[lower]
        differ = one != other
        if not differ.any():
            return first
        low, high = np.minimum(one, other)[differ], np.maximum(one, other)[differ]
        np.minimum.at(first, high, low)
        while (jumped := first[first]).tobytes() != first.tobytes():
            first = jumped
