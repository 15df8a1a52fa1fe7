"""A bounded queue with one thread behind it: `put` never waits, a full queue loses its oldest."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

DRAIN_S = 2.0  # time to send the queue at the end of a run


class SendQueue(Generic[T]):
    """Calls `step` with each item in a thread of its own; `dropped` counts the items lost."""

    def __init__(self, step: Callable[[T], None], limit: int) -> None:
        self._step, self._limit = step, limit
        self._queue: deque[T] = deque(maxlen=limit)
        self._wake, self._closing = threading.Event(), threading.Event()
        self.dropped = 0
        self._thread = threading.Thread(target=self._work, name="bridge", daemon=True)
        self._thread.start()

    def put(self, item: T) -> None:
        self.dropped += len(self._queue) == self._limit
        self._queue.append(item)
        self._wake.set()

    def close(self) -> bool:
        """Process the queued items, within DRAIN_S; return False if it was closed before."""
        if self._closing.is_set():
            return False
        self._closing.set()
        self._wake.set()
        self._thread.join(DRAIN_S)
        return True

    def _work(self) -> None:
        while not (self._closing.is_set() and not self._queue):
            self._wake.wait()
            self._wake.clear()
            while self._queue:
                self._step(self._queue.popleft())
