"""Keys of the terminal on stdin as they are pressed: on POSIX systems, and in Windows' console."""

from __future__ import annotations

import os
import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# Reader of the bytes within a time, in the words of a VT100; nothing: no key; None: the terminal
# was closed.
ReadKeys = Callable[[float], bytes | None]

CONSOLE_LOOK_S = 0.01  # time between two looks at Windows' console, which cannot be waited for
CONSOLE_ARROWS = {"H": b"\x1b[A", "P": b"\x1b[B", "M": b"\x1b[C", "K": b"\x1b[D"}


def has_mouse() -> bool:
    """Whether the terminal can report its mouse."""
    try:
        import termios  # noqa: F401
    except ImportError:
        return False
    return True


@contextmanager
def open_keys() -> Iterator[ReadKeys]:
    """Read keys one by one, without an echo."""
    try:
        import termios
        import tty
    except ImportError:
        yield _read_console
        return
    handle = sys.stdin.fileno()
    before = termios.tcgetattr(handle)
    tty.setcbreak(handle)
    try:
        yield lambda timeout_s: _read_terminal(handle, timeout_s)
    finally:
        termios.tcsetattr(handle, termios.TCSADRAIN, before)


def _read_terminal(handle: int, timeout_s: float) -> bytes | None:
    if not select.select([handle], [], [], timeout_s)[0]:
        return b""
    try:
        return os.read(handle, 1024) or None
    except OSError:
        return None


def _read_console(timeout_s: float) -> bytes:
    import msvcrt

    console: Any = msvcrt
    end_s = time.monotonic() + timeout_s
    while not console.kbhit():
        if time.monotonic() >= end_s:
            return b""
        time.sleep(CONSOLE_LOOK_S)
    key: str = console.getwch()
    if key in "\x00\xe0":  # the first half of a key that is no character
        return CONSOLE_ARROWS.get(console.getwch(), b"")
    return key.encode("latin-1", "ignore")
