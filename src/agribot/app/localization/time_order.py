"""Samples in the order of their stamps, with bounded memory."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator

from agribot.app.localization.log import LogChannel, LogEntry, RobotLog

# Longest that a driver takes from measurement to log, s.
WAIT_S = 2.0


def order_by_stamp(entries: Iterable[LogEntry], wait_s: float = WAIT_S) -> Iterator[LogEntry]:
    """Yield entries by their stamps, which may lie up to `wait_s` behind the newest one.

    What comes still later is left out.
    """
    waiting: list[tuple[float, int, LogEntry]] = []
    newest_s = last_s = -math.inf
    for number, entry in enumerate(entries):
        if entry.stamp_s < last_s:
            continue
        heapq.heappush(waiting, (entry.stamp_s, number, entry))
        newest_s = max(newest_s, entry.stamp_s)
        while waiting and waiting[0][0] <= newest_s - wait_s:
            last_s, _, ordered = heapq.heappop(waiting)
            yield ordered
    while waiting:
        yield heapq.heappop(waiting)[2]


class RestampedLog:
    """A log by the times of its recorder instead of its stamps."""

    def __init__(self, log: RobotLog) -> None:
        self._log = log
        self.channels: tuple[LogChannel, ...] = log.channels
        self.read_transforms = log.read_transforms

    @property
    def notes(self) -> list[str]:
        return self._log.notes

    def entries(self) -> Iterator[LogEntry]:
        return (entry._replace(stamp_s=entry.logged_s) for entry in self._log.entries())
