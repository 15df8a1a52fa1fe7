"""One thread behind a bounded queue: whoever puts goes on at once, the oldest is lost."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

LAST_WORDS_S = 2.0  # to send what is queued when the run ends


class SendQueue(Generic[T]):
    """`step` is called from the queue's own thread; `dropped` counts what found it full."""

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
        """Work off what is queued, within a moment. Returns False when that was done before."""
        if self._closing.is_set():
            return False
        self._closing.set()
        self._wake.set()
        self._thread.join(LAST_WORDS_S)
        return True

    def _work(self) -> None:
        while not (self._closing.is_set() and not self._queue):
            self._wake.wait()
            self._wake.clear()
            while self._queue:
                self._step(self._queue.popleft())
