"""Files that a page keeps on the robot by name: fields, views."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec

from agribot.core.whole_file import write_at_once
from agribot.ui.server.answers import Unusable

_NAME = re.compile(r"^[^\W_][\w .()-]{0,62}$")


def checked_name(name: str) -> str:
    """Refuse a name that could leave the folder.

    Raises: Unusable: a name that is no plain file name.
    """
    if not _NAME.fullmatch(name) or ".." in name:
        raise Unusable(
            400,
            f"name '{name[:80]}' is unusable; use up to 63 letters, digits, spaces and . _ - ( )",
        )
    return name


class Store:
    """One JSON document per name; what is written is there whole or not at all."""

    def __init__(self, folder: Path, suffix: str) -> None:
        self._folder, self._suffix = folder, suffix

    def names(self) -> list[str]:
        paths = self._folder.glob(f"*{self._suffix}")
        return sorted(path.name.removesuffix(self._suffix) for path in paths)

    def read(self, name: str) -> bytes:
        """Read a document.

        Raises: Unusable: no document has this name.
        """
        try:
            return self._path(name).read_bytes()
        except OSError as error:
            raise Unusable(404, f"nothing is stored under '{name}'; load the page again") from error

    def write(self, name: str, document: Any) -> None:
        """Store a document.

        Raises: Unusable: the disk does not take it.
        """
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            write_at_once(self._path(name), msgspec.json.encode(document))
        except OSError as error:
            raise Unusable(
                507, f"cannot store '{name}': {error.strerror}; free disk space"
            ) from error

    def delete(self, name: str) -> None:
        """Delete a document.

        Raises: Unusable: no document has this name.
        """
        try:
            self._path(name).unlink()
        except OSError as error:
            raise Unusable(404, f"nothing is stored under '{name}'; load the page again") from error

    def _path(self, name: str) -> Path:
        return self._folder / f"{checked_name(name)}{self._suffix}"
