"""Patience for what another process does: only its absence fails, never its slowness."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

PATIENCE_S = 180.0
POLL_S = 0.02
T = TypeVar("T")


def wait_for(ask: Callable[[], T | None], what: str, patience_s: float = PATIENCE_S) -> T:
    """The first true value that `ask` gives, however often it has to be asked."""
    end_s = time.monotonic() + patience_s
    while not (value := ask()):
        assert time.monotonic() < end_s, f"waited {patience_s:g} s in vain for {what}"
        time.sleep(POLL_S)
    return value


@contextmanager
def interrupted_once(is_so: Callable[[], object]) -> Iterator[None]:
    """Press Ctrl-C in a command of this process once it is so."""
    ended = threading.Event()
    # Where a shell starts the tests behind it (`make test &`), Ctrl-C is ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def look() -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not is_so() and time.monotonic() < end_s:
            if ended.wait(POLL_S):
                return
        os.kill(os.getpid(), signal.SIGINT)

    hand = threading.Thread(target=look)
    hand.start()
    try:
        yield
    finally:
        ended.set()
        hand.join()
        signal.signal(signal.SIGINT, before)
