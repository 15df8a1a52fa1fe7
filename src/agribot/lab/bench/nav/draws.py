"""Random numbers of the benchmark: one stream for each purpose of each seed."""

from __future__ import annotations

import math

import numpy as np

BLOCK = 256


class Draws:
    """Rows of standard normal numbers, drawn in blocks because single draws are slow."""

    def __init__(self, seed: int, stream: int, channels: int) -> None:
        self._rng = np.random.Generator(np.random.SFC64(np.random.SeedSequence([stream, seed])))
        self._channels = channels
        self._rows: list[list[float]] = []
        self._next = 0

    def take(self) -> list[float]:
        """Return the next row, `channels` numbers."""
        if self._next == len(self._rows):
            self._rows = self._draw((BLOCK, self._channels)).tolist()
            self._next = 0
        row = self._rows[self._next]
        self._next += 1
        return row

    def _draw(self, shape: tuple[int, int]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return self._rng.standard_normal(shape)


class Coins(Draws):
    """The same with numbers uniform in [0, 1)."""

    def _draw(self, shape: tuple[int, int]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return self._rng.random(shape)


class SlowError:
    """A first-order Gauss-Markov process that starts at 0."""

    def __init__(self, std: float, memory_s: float, dt_s: float) -> None:
        self._kept = math.exp(-dt_s / memory_s)
        self._fresh = std * math.sqrt(1.0 - self._kept * self._kept)
        self.value = 0.0

    def step(self, normal: float) -> float:
        """Return the value one time step later."""
        self.value = self._kept * self.value + self._fresh * normal
        return self.value
