"""Bytes to a device from the control loop, which never waits for the line."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

# Longest wait of bytes that a line has not taken, s: an older speed is not safe to drive with, and
# the board stops by itself.
LONGEST_WAIT_S = 0.1
MOST_WAITING = 16


class StreamWriter:
    """Writes in a thread of its own what `send` is given, the oldest first, until it is closed."""

    def __init__(
        self, name: str, write: Callable[[bytes], bool], now_s: Callable[[], float]
    ) -> None:
        """`write` may wait for the line; what is sent while the line is away is lost."""
        self._write, self._now_s = write, now_s
        self._waiting: deque[tuple[float, bytes]] = deque(maxlen=MOST_WAITING)
        self._changed = threading.Condition()
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, name=f"writes {name}", daemon=True)
        self._thread.start()

    def send(self, data: bytes) -> None:
        if data:
            with self._changed:
                self._waiting.append((self._now_s(), data))
                self._changed.notify()

    def close(self, patience_s: float = LONGEST_WAIT_S) -> None:
        """Write what waits, for as long as `patience_s`, and end the thread. Safe to call twice."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        self._thread.join(patience_s)

    def _run(self) -> None:
        while (data := self._take()) is not None:
            self._write(data)

    def _take(self) -> bytes | None:
        """Wait for the next bytes that are young enough; None at the end."""
        with self._changed:
            while True:
                while self._waiting:
                    sent_s, data = self._waiting.popleft()
                    if self._now_s() - sent_s <= LONGEST_WAIT_S:
                        return data
                if self._is_closed:
                    return None
                self._changed.wait()
