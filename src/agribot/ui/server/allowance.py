"""How much a line may bring. Nothing here knows a clock: the caller says what time it is."""

from __future__ import annotations

from collections.abc import Iterator

MAX_FRAMES_PER_S = 120  # frames a second, six times as many as driving at 20 Hz needs
MAX_BURST = 480  # frames that arrive at once after some seconds without Wi-Fi
FREE_BYTES = 1024  # size of a frame that counts as one; a frame of N times as many counts as N more


class Allowance:
    def __init__(self, now_s: float) -> None:
        self._left, self._at_s = float(MAX_BURST), now_s

    def take(self, now_s: float, cost: float = 1.0) -> bool:
        """Whether another `cost` is within the limit; if it is, count it."""
        refill = (now_s - self._at_s) * MAX_FRAMES_PER_S
        self._left, self._at_s = min(self._left + refill, MAX_BURST), now_s
        if self._left < cost:
            return False
        self._left -= cost
        return True


class FrameAllowance:
    """Counts the frames of a WebSocket by their heads, before anything else is done with them.

    Every kind counts, ping, pong and empty continuation included: each costs the server as much
    as a message.
    """

    def __init__(self, now_s: float) -> None:
        self._allowance = Allowance(now_s)
        self._head = b""  # head of a frame, if the data ended within it
        self._skip_bytes = 0  # bytes of the frame under way that are still to come

    def find_excess(self, data: bytes, now_s: float) -> int | None:
        """Return how many bytes of `data` end with the first frame above the limit, or None."""
        for end, size_bytes in self._find_frames(data):
            if not self._allowance.take(now_s, 1.0 + size_bytes // FREE_BYTES):
                return end
        return None

    def _find_frames(self, data: bytes) -> Iterator[tuple[int, int]]:
        """Yield where each frame ends and its size, as soon as its head is there."""
        before, at = len(self._head), self._skip_bytes
        data = self._head + data
        while size_bytes := read_frame_size(data, at):
            at += size_bytes
            yield at - before, size_bytes
        self._head, self._skip_bytes = data[at:], max(0, at - len(data))


def read_frame_size(data: bytes, at: int) -> int:
    """Read the size of the frame at `at` (RFC 6455, 5.2); 0 where its head is not whole."""
    if len(data) < at + 2:
        return 0
    has_mask, short = data[at + 1] >= 0x80, data[at + 1] & 0x7F
    more = {126: 2, 127: 8}.get(short, 0)
    if len(data) < at + 2 + more:
        return 0
    size_bytes = int.from_bytes(data[at + 2 : at + 2 + more]) if more else short
    return 2 + more + (4 if has_mask else 0) + size_bytes
