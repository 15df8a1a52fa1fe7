"""Which programs have a device in their hands: by their open files, and by lock files.

Sources: proc(5), /proc/PID/fd; the Filesystem Hierarchy Standard 3.0, device lock files of
/var/lock (LCK..ttyUSB0 with the number of a process).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

LOCK_FOLDERS = ("run/lock", "var/lock", "run/lock/lockdev")


class Holder(NamedTuple):
    """A program that uses a device."""

    process: int
    program: str

    def __str__(self) -> str:
        return f"{self.program} (process {self.process})"


def find_holders(node: str, root: Path = Path("/"), processes: Path = Path("/proc")) -> set[Holder]:
    """Find the other programs that use the device at `node` below `root`.

    Those of other users are seen by root alone, or where they left a lock file.
    """
    device = os.path.realpath(root / node.lstrip("/"))
    found = set(_list_openers(device, processes))
    found |= set(_list_lockers(os.path.basename(node), root, processes))
    return {holder for holder in found if holder.process != os.getpid()}


def _list_openers(device: str, processes: Path) -> Iterator[Holder]:
    for folder in processes.glob("[0-9]*"):
        try:
            files = [os.readlink(link) for link in (folder / "fd").iterdir()]
        except OSError:  # it has ended, or is another user's
            continue
        if device in files:
            yield _name(folder)


def _list_lockers(name: str, root: Path, processes: Path) -> Iterator[Holder]:
    for place in LOCK_FOLDERS:
        try:
            text = (root / place / f"LCK..{name}").read_text("ascii", errors="replace").strip()
        except OSError:
            continue
        number = text.split()[0] if text else ""
        if number.isdecimal() and (processes / number).exists():  # else its program has ended
            yield _name(processes / number)


def _name(folder: Path) -> Holder:
    try:
        program = (folder / "comm").read_text("utf-8", errors="replace").strip()
    except OSError:
        program = "a program"
    return Holder(int(folder.name), program)
