"""The processes below another one, as /proc shows them; none elsewhere than on Linux."""

from __future__ import annotations

from pathlib import Path

PARENT = 1  # field of /proc/PID/stat behind the name


def find_descendants(root: int) -> dict[int, list[str]]:
    """Find all processes below `root`: their ids, and the fields of their stat behind the name."""
    children: dict[int, dict[int, list[str]]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has just ended
        children.setdefault(int(fields[PARENT]), {})[int(path.parent.name)] = fields
    found: dict[int, list[str]] = {}
    waiting = [root]
    while waiting:
        below = children.get(waiting.pop(), {})
        found |= below
        waiting += below
    return found
