"""One seeded random stream per purpose: adding a sensor changes no other sensor's errors."""

from __future__ import annotations

import zlib

import numpy as np

from agribot.core.messages import FloatArray

BLOCK_ROWS = 1024


def make_stream(seed: int, name: str) -> np.random.Generator:
    """Make the generator of `name`; it depends on the seed and the name only."""
    key = zlib.crc32(name.encode())
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(key,))))


class NormalRows:
    """Rows of standard normal numbers, drawn in blocks because single draws are slow."""

    def __init__(self, rng: np.random.Generator, columns: int) -> None:
        self._rng = rng
        self._columns = columns
        self._block = np.empty((0, columns))
        self._used = 0

    def take(self, rows: int) -> FloatArray:
        """Return the next numbers, (rows, columns): a view that is valid until the next call."""
        if self._used + rows > len(self._block):
            left = self._block[self._used :]
            fresh = self._rng.standard_normal((max(BLOCK_ROWS, rows), self._columns))
            self._block = np.concatenate((left, fresh))
            self._used = 0
        taken = self._block[self._used : self._used + rows]
        self._used += rows
        return taken
