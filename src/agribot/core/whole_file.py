"""Replace a file at once: a reader sees the old or the new content, never half of it."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

# Errors of a folder that takes no second file, or lets none replace the first.
_NO_ROOM_BESIDE = (errno.EACCES, errno.EPERM, errno.EROFS, errno.EBUSY)


def write_at_once(path: Path, data: bytes, *, is_synced: bool = False) -> None:
    """Write a temporary file beside the path and put it in its place.

    An older file keeps its permissions. Links are followed. What is there and is no regular file,
    such as a pipe, is written directly, and so is a file whose folder takes no other one.
    `is_synced` waits for the disk first.
    Raises: OSError: it cannot be written.
    """
    old = _read_status(path)
    if old is not None and not stat.S_ISREG(old.st_mode):
        path.write_bytes(data)
        return
    target = Path(os.path.realpath(path))
    beside = target.with_name(f".{target.name[:40]}.{secrets.token_hex(8)}.new")
    try:
        _write_new(beside, data, is_synced)
        if old is not None:
            with suppress(OSError):  # a file system without permissions
                shutil.copymode(target, beside)
        beside.replace(target)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        if old is None or error.errno not in _NO_ROOM_BESIDE:
            raise
        path.write_bytes(data)


def make_at_once(path: Path, make: Callable[[Path], T]) -> T:
    """Let `make` write a file beside the path, put it in its place, and give what `make` gave.

    It is for files that a library writes by their path, and for long ones. What an earlier call
    that was killed left is removed, and so is the temporary file when `make` fails; the old file
    then stays. What `write_at_once` says of permissions, links and pipes holds here too.
    Raises: OSError: it cannot be replaced; whatever `make` raises.
    """
    old = _read_status(path)
    if old is not None and not stat.S_ISREG(old.st_mode):
        return make(path)
    target = Path(os.path.realpath(path))
    beside = target.with_name(f".{target.name[:60]}.new")
    try:
        beside.unlink(missing_ok=True)
        made = make(beside)
        if old is not None:
            with suppress(OSError):  # a file system without permissions
                shutil.copymode(target, beside)
        beside.replace(target)
    except OSError as error:
        if old is None or error.errno not in _NO_ROOM_BESIDE:
            raise
        return make(path)
    else:
        return made
    finally:
        with suppress(OSError):
            beside.unlink()


def _write_new(path: Path, data: bytes, is_synced: bool) -> None:
    with path.open("xb") as file:
        file.write(data)
        if is_synced:
            file.flush()
            os.fsync(file.fileno())


def _read_status(path: Path) -> os.stat_result | None:
    """Return the status of what the path leads to; None where nothing is there."""
    try:
        return path.stat()
    except FileNotFoundError:
        return None
