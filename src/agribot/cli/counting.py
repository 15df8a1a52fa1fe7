"""Progress of countable work on stderr: a bar on a terminal, else a plain line now and then."""

from __future__ import annotations

import sys
import time
from typing import TextIO

BAR_WIDTH = 24
BAR_EVERY_S = 0.2
LINE_EVERY_S = 5.0


class CountProgress:
    """A display of how many of `total` things are done, how fast, and the time left."""

    def __init__(self, total: int, what: str, stream: TextIO | None = None) -> None:
        self._total = total
        self._what = what
        self._stream = sys.stderr if stream is None else stream
        self._is_terminal = self._stream.isatty()
        self._started: tuple[float, int] | None = None
        self._shown_s = -LINE_EVERY_S
        self._shown_count = -1

    def __call__(self, done: int, note: str = "") -> None:
        now_s = time.monotonic()
        if self._started is None:
            self._started = (now_s, done)
        every_s = BAR_EVERY_S if self._is_terminal else LINE_EVERY_S
        is_due = now_s - self._shown_s >= every_s or bool(note) or done == self._total
        if not is_due or (done == self._shown_count and not note):
            return
        self._shown_s, self._shown_count = now_s, done
        text = self._format_line(done, now_s) + (f"  {note}" if note else "")
        self._stream.write(f"\r{text}\x1b[K" if self._is_terminal else f"{text}\n")
        self._stream.flush()

    def close(self) -> None:
        if self._is_terminal and self._shown_count >= 0:
            self._stream.write("\n")
            self._stream.flush()

    def _format_line(self, done: int, now_s: float) -> str:
        ratio = done / self._total if self._total else 1.0
        bar = "#" * round(ratio * BAR_WIDTH)
        text = f"[{bar:-<{BAR_WIDTH}}] {done}/{self._total} {self._what}"
        assert self._started is not None
        spent_s, fresh = now_s - self._started[0], done - self._started[1]
        if fresh and spent_s > 0.0:
            left_s = (self._total - done) * spent_s / fresh
            text += f"  {fresh / spent_s:.2g}/s  {left_s:.0f} s left"
        return text
