"""Batches that are drawn ahead of the training, by threads, in the order of its steps."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from torch import Tensor

# Random batch of images (N, 3, S, S) float32 in 0..255 and labels (N, S, S) int64, or for a network
# that finds plants the targets of `plant_targets`.
BatchSource = Callable[[np.random.Generator], tuple[Tensor, Tensor]]

AHEAD = 2  # batches for each worker


class BatchLoader:
    """Draws the batch of a step from a generator of (seed, step, rank) alone.

    So the batches are the same with any number of `workers`; with 0, each is drawn when it is asked
    for. A source that several workers draw from must bear calls at once.
    """

    def __init__(
        self, batches: BatchSource, seed: int, rank: int, steps: int, workers: int = 0
    ) -> None:
        self._batches, self._seed, self._rank, self._steps = batches, seed, rank, steps
        self._workers = workers
        self._pool = ThreadPoolExecutor(workers, "batches") if workers else None
        self._ahead: dict[int, Future[tuple[Tensor, Tensor]]] = {}

    def take(self, step: int) -> tuple[Tensor, Tensor]:
        """Return the batch of a step; what its source raised is raised here."""
        if self._pool is None:
            return self._draw(step)
        for later in range(step, min(self._steps, step + 1 + AHEAD * self._workers)):
            if later not in self._ahead:
                self._ahead[later] = self._pool.submit(self._draw, later)
        drawn = self._ahead.pop(step, None)
        return self._draw(step) if drawn is None else drawn.result()

    def close(self) -> None:
        """Draw no more ahead, and wait for what is being drawn."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        self._ahead.clear()

    def _draw(self, step: int) -> tuple[Tensor, Tensor]:
        return self._batches(np.random.default_rng([self._seed, step, self._rank]))
