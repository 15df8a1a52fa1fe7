"""Writing the files that a command was asked for."""

from __future__ import annotations

from pathlib import Path

from agribot.errors import MissionError


def write_file(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise MissionError(f"cannot write {path}: {error.strerror}; choose another file") from error
