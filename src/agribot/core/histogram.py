"""A histogram of many numbers: small, can be saved, and can be joined with another."""

from __future__ import annotations

import msgspec
import numpy as np
import numpy.typing as npt


class Histogram(msgspec.Struct, kw_only=True):
    """Counts of the numbers in [i width, (i + 1) width), by i; only bins that hold any."""

    width: float
    counts: dict[int, int] = {}

    def add(self, values: npt.ArrayLike) -> None:
        """Count finite numbers of any shape."""
        bins, counts = np.unique(np.floor(np.asarray(values) / self.width), return_counts=True)
        for index, count in zip(bins.astype(int).tolist(), counts.tolist(), strict=True):
            self.counts[index] = self.counts.get(index, 0) + count

    def percentile(self, percent: float) -> float | None:
        """Give a percentile to within half a width; None where there are no numbers."""
        if not self.counts:
            return None
        indices = sorted(self.counts)
        reached = np.cumsum([self.counts[index] for index in indices])
        place = int(np.searchsorted(reached, percent / 100.0 * reached[-1]))
        return (indices[min(place, len(indices) - 1)] + 0.5) * self.width
