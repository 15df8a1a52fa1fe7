"""The processes below another one, as /proc shows them; none elsewhere than on Linux."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path


def find_descendants(root: int) -> dict[int, list[str]]:
    """Find all processes below `root`: their ids, and the fields of their stat behind the name."""
    found: dict[int, list[str]] = {}
    waiting = [root]
    while waiting:
        for child in list_children(waiting.pop()):
            try:
                stat = Path(f"/proc/{child}/stat").read_text()
            except OSError:
                continue  # it has just ended
            found[child] = stat.rpartition(")")[2].split()
            waiting.append(child)
    return found


def list_children(pid: int) -> Iterator[int]:
    """List the processes that the threads of a process started and that still live."""
    for thread in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            yield from map(int, thread.read_text().split())
        except OSError:
            continue  # it has just ended
