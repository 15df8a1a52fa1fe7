"""Signals that end a program, as far as this system has them: Windows knows no hang-up."""

from __future__ import annotations

import signal

HANG_UP: signal.Signals | None = getattr(signal, "SIGHUP", None)  # signal of a closed terminal


def ignore_interrupts() -> None:
    """Leave it to the parent process when this one stops."""
    for number in (signal.SIGINT, HANG_UP):
        if number is not None:
            signal.signal(number, signal.SIG_IGN)
