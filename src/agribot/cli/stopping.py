"""A first Ctrl-C or SIGTERM requests a clean stop, a second one interrupts at once.

A terminal that is closed, as with its SSH connection, requests the stop, too.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

from agribot.cli.standard_error import drop_output
from agribot.core.signals import HANG_UP


@contextmanager
def stop_on_signal() -> Iterator[list[int]]:
    """Yield a list that a first Ctrl-C or SIGTERM makes true; the second one interrupts.

    So does a terminal that is closed, unless that is ignored (nohup): later messages have no
    reader then, and the program goes on to its end.
    """
    received: list[int] = []
    terminals = [number for number in (1, 2) if os.isatty(number)]

    def note(signum: int, _frame: object) -> None:
        received.append(signum)
        if signum == HANG_UP:
            signal.signal(signum, signal.SIG_IGN)  # it comes from the shell and from the system
            drop_output(*terminals)
        else:
            signal.signal(signum, signal.default_int_handler)

    numbers = [signal.SIGINT, signal.SIGTERM]
    if HANG_UP is not None and signal.getsignal(HANG_UP) != signal.SIG_IGN:
        numbers.append(HANG_UP)
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
