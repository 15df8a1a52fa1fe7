"""Random numbers of many robots: each seed has its own streams, whoever drives beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agribot.core.messages import FloatArray

BLOCK = 256


class Draws:
    """Rows of standard normal numbers, (channels, N) at a time, one column per seed."""

    def __init__(self, seeds: Sequence[int], stream: int, channels: int) -> None:
        self._generators = [
            np.random.Generator(np.random.SFC64(np.random.SeedSequence([stream, seed])))
            for seed in seeds
        ]
        self._block = np.empty((BLOCK, channels, len(seeds)))
        self._next = BLOCK

    def normals(self) -> FloatArray:
        if self._next == BLOCK:
            shape = self._block.shape[:2]
            for index, generator in enumerate(self._generators):
                self._block[:, :, index] = generator.standard_normal(shape)
            self._next = 0
        row: FloatArray = self._block[self._next]
        self._next += 1
        return row


class Coins(Draws):
    """The same with numbers uniform in [0, 1)."""

    def uniforms(self) -> FloatArray:
        if self._next == BLOCK:
            shape = self._block.shape[:2]
            for index, generator in enumerate(self._generators):
                self._block[:, :, index] = generator.random(shape)
            self._next = 0
        row: FloatArray = self._block[self._next]
        self._next += 1
        return row


def wander(
    value: FloatArray, std: float, memory_s: float, dt_s: float, normal: FloatArray
) -> FloatArray:
    """One step of a first-order Gauss-Markov process."""
    kept = float(np.exp(-dt_s / memory_s))
    step: FloatArray = kept * value + std * np.sqrt(1.0 - kept * kept) * normal
    return step
