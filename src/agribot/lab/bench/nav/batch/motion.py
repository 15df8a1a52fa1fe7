"""Steps, standstill and history of many robots that share their sampling times."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from agribot.autonomy.estimate.standstill import (
    FLOOR_STD_RADPS,
    MAX_RATE_RADPS,
    MAX_TRAVEL_M,
    WINDOW_S,
)
from agribot.core.messages import FloatArray
from agribot.lab.bench.nav.batch.ekf import Mask


class BatchMotion(NamedTuple):
    """As history.Motion; all arrays (N,)."""

    t_s: float
    x_m: FloatArray
    y_m: FloatArray
    yaw_rad: FloatArray
    wheel_mps: FloatArray
    yaw_rate_radps: FloatArray


class BatchHistory:
    """As history.MotionHistory."""

    def __init__(self, capacity: int = 512) -> None:
        self._ring: deque[BatchMotion] = deque(maxlen=capacity)

    def append(self, motion: BatchMotion) -> None:
        self._ring.append(motion)

    @property
    def newest(self) -> BatchMotion | None:
        return self._ring[-1] if self._ring else None

    def at(self, t_s: float) -> BatchMotion | None:
        later: BatchMotion | None = None
        for motion in reversed(self._ring):
            if motion.t_s <= t_s:
                return motion if later is None else _between(motion, later, t_s)
            later = motion
        return None


def _between(a: BatchMotion, b: BatchMotion, t_s: float) -> BatchMotion:
    part = (t_s - a.t_s) / (b.t_s - a.t_s)
    if part == 0.0:
        return a
    values = (old + part * (new - old) for old, new in zip(a[1:], b[1:], strict=True))
    return BatchMotion(t_s, *values)


class BatchStandstill:
    """As standstill.Standstill, for wheels that all travel alike."""

    def __init__(self, count: int) -> None:
        self.is_still: Mask = np.zeros(count, dtype=bool)
        self._travel_m, self._age_s = np.zeros(count), np.zeros(count)
        self._count, self._sum, self._square_sum = (np.zeros(count) for _ in range(3))

    def update(
        self, dt_s: float, travel_m: FloatArray, rate_radps: FloatArray
    ) -> tuple[Mask, FloatArray, FloatArray] | None:
        """Where a quiet window completed, its mean rate and variance; None where none did."""
        self._travel_m += travel_m
        moves = (abs(self._travel_m) > MAX_TRAVEL_M) | (abs(rate_radps) > MAX_RATE_RADPS)
        self.is_still &= ~moves
        self._age_s += dt_s
        self._count += 1
        self._sum += rate_radps
        self._square_sum += rate_radps * rate_radps
        full = ~moves & ~(self._age_s < WINDOW_S)
        result = None
        if full.any():
            mean = self._sum / self._count
            spread = np.maximum(self._square_sum / self._count - mean * mean, 0.0)
            result = full, mean, spread / self._count + FLOOR_STD_RADPS**2
            self.is_still |= full
        restart = moves | full
        for total in (self._travel_m, self._age_s, self._count, self._sum, self._square_sum):
            total[restart] = 0.0
        return result


class BatchGate:
    """As gate.Gate; robots outside the mask have no measurement and keep their count."""

    def __init__(self, count: int, sigma: float, recover_after: int) -> None:
        self.limit = sigma * sigma
        self.rejected_in_a_row = np.zeros(count, dtype=np.int64)
        self._recover_after = recover_after

    def evaluate(self, distance2: FloatArray, mask: Mask | None = None) -> tuple[Mask, Mask]:
        """Who is accepted and who recovers."""
        fits = distance2 <= self.limit
        seen = np.ones_like(fits) if mask is None else mask
        accepted = fits & seen
        self.rejected_in_a_row[accepted] = 0
        self.rejected_in_a_row += ~fits & seen
        recovers = self.rejected_in_a_row >= self._recover_after
        self.rejected_in_a_row[recovers] = 0
        return accepted, recovers
