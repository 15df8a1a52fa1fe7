"""Hide from `agribot` what Windows lacks, and give it Windows' console on this one's terminal."""

from __future__ import annotations

import builtins
import os
import select
import signal
import types
from typing import Any

POSIX = {"curses", "fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}
load = builtins.__import__


def hide(name: str, globals: Any = None, *more: Any, **words: Any) -> Any:
    importer = str((globals or {}).get("__package__") or "")
    if importer.partition(".")[0] == "agribot":
        if name in POSIX:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        if name == "msvcrt":
            return console
    return load(name, globals, *more, **words)


def lock(handle: int, mode: int, count: int) -> None:
    import fcntl

    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def has_key() -> bool:
    return bool(select.select([0], [], [], 0.0)[0])


def get_key() -> str:
    return os.read(0, 1).decode("latin-1")


builtins.__import__ = hide
console = types.ModuleType("msvcrt")
vars(console).update(locking=lock, LK_NBLCK=2, kbhit=has_key, getwch=get_key)
for module, name in ((signal, "SIGHUP"), (os, "sched_getaffinity"), (os, "getloadavg")):
    delattr(module, name)
