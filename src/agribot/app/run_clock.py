"""Costs of a run."""

from __future__ import annotations

import time


class Clock:
    """Wall and CPU time of this process while a run drives."""

    def __init__(self) -> None:
        self._started: tuple[float, float] | None = None
        self.wall_s = self.cpu_s = 0.0

    @property
    def spent(self) -> tuple[float, float]:
        """Wall and CPU seconds up to now."""
        if self._started is None:
            return self.wall_s, self.cpu_s
        wall_s, cpu_s = self._started
        return (
            self.wall_s + time.monotonic() - wall_s,
            self.cpu_s + time.process_time() - cpu_s,
        )

    def start(self) -> None:
        self._started = (time.monotonic(), time.process_time())

    def stop(self) -> None:
        self.wall_s, self.cpu_s = self.spent
        self._started = None
