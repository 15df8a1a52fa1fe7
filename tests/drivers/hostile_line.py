"""A line between a board and its codec that delays, loses and adds bytes, seeded and without time.

What is sent keeps its order. `unit` is what gets lost as a whole: a byte of a serial line, a frame
of a CAN bus.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np


class Hostility(NamedTuple):
    """`strays` come between whole pieces, `stray_hz` of them; nothing passes in `pauses_s`."""

    latency_s: float = 0.06
    jitter_s: float = 0.004
    loss_ratio: float = 0.0
    stray_hz: float = 0.0
    strays: tuple[bytes, ...] = (b"unknown command\r\n",)
    pauses_s: tuple[tuple[float, float], ...] = ()
    unit: int = 1


class HostileLine:
    """One way of a line; half of the latency is passed on each."""

    def __init__(self, hostility: Hostility, rng: np.random.Generator, *, has_strays: bool) -> None:
        self._way, self._rng, self._has_strays = hostility, rng, has_strays
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._due_s = 0.0

    def send(self, data: bytes, now_s: float, dt_s: float) -> None:
        """Send what was said within the last `dt_s`."""
        way, rng = self._way, self._rng
        units = [data[k : k + way.unit] for k in range(0, len(data), way.unit)]
        kept = b"".join(unit for unit in units if rng.random() >= way.loss_ratio)
        if self._has_strays and rng.random() < way.stray_hz * dt_s:
            kept += way.strays[rng.integers(len(way.strays))]
        delay_s = way.latency_s / 2.0 + abs(way.jitter_s * rng.standard_normal())
        self._due_s = max(self._due_s, now_s + delay_s)
        for start_s, end_s in way.pauses_s:
            if start_s <= self._due_s < end_s:
                self._due_s = end_s
        if kept:
            self._waiting.append((self._due_s, kept))

    def take(self, now_s: float) -> list[bytes]:
        """Take what has come until now, cut anywhere; its end may be late."""
        come = b""
        while self._waiting and self._waiting[0][0] <= now_s:
            come += self._waiting.popleft()[1]
        cuts = np.sort(self._rng.integers(0, len(come) + 1, 2)).tolist()
        first, second, last = come[: cuts[0]], come[cuts[0] : cuts[1]], come[cuts[1] :]
        if last and self._rng.random() < 0.2:
            self._waiting.appendleft((now_s, last))
            last = b""
        return [piece for piece in (first, second, last) if piece]
