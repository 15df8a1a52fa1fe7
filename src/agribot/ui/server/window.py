"""How much may be on its way to a page that says what it has received."""

from __future__ import annotations

from collections import deque

LEAST_BYTES = 4096  # eight states: 30 a second over a line of a quarter of a second
MOST_BYTES = 256 * 1024
QUICK_S, SLOW_S = 0.15, 0.5


class Window:
    """Grows while what fills it arrives quickly, shrinks to its least where that takes long.

    A slow line therefore carries new states seldom rather than old ones, whatever buffers lie
    between. It knows no clock. A client that does not acknowledge has no limit here.
    """

    def __init__(self, *, is_acknowledged: bool) -> None:
        self.size_bytes = LEAST_BYTES
        self._is_acknowledged = is_acknowledged
        self._sent: deque[tuple[int, float]] = deque()  # bytes, when; oldest first
        self._under_way = self._received = 0

    @property
    def has_room(self) -> bool:
        return self._under_way < self.size_bytes

    def note_sent(self, size_bytes: int, now_s: float) -> None:
        if self._is_acknowledged:
            self._sent.append((size_bytes, now_s))
            self._under_way += size_bytes

    def note_received(self, count: int, now_s: float) -> None:
        """`count` messages since the line was opened; more than were sent count as all."""
        was_full = not self.has_room
        sent_s = now_s
        while self._received < count and self._sent:
            size_bytes, sent_s = self._sent.popleft()
            self._under_way -= size_bytes
            self._received += 1
        if now_s - sent_s > SLOW_S:
            self.size_bytes = max(self.size_bytes // 2, LEAST_BYTES)
        elif was_full and now_s - sent_s < QUICK_S:
            self.size_bytes = min(self.size_bytes * 2, MOST_BYTES)

    def waiting_s(self, now_s: float) -> float:
        """How long the oldest message waits for its acknowledgement; 0 where none does."""
        return now_s - self._sent[0][1] if self._sent else 0.0
