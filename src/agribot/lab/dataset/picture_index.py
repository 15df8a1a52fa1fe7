"""Find the picture that a labelling tool names, in any folder."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path, PurePosixPath

from agribot.lab.dataset.foreign.shapes import LabelFileError
from agribot.lab.dataset.pictures import SUFFIXES

MOST_FILES = 200_000
UPLOAD = re.compile(r"^[0-9a-f]{8}-")  # prefix of an upload's name in Label Studio


class PictureIndex:
    """The pictures of some folders by their names; what a tool names is never opened as a path."""

    def __init__(self, folders: tuple[Path, ...]) -> None:
        self._folders = folders
        self._found: defaultdict[str, list[Path]] = defaultdict(list)
        for folder in folders:
            for count, path in enumerate(sorted(folder.rglob("*"))):
                if count >= MOST_FILES:
                    break
                if path.suffix.lower() in SUFFIXES and path not in self._found[path.stem]:
                    self._found[path.stem].append(path)

    def find(self, named: str) -> Path:
        """Find the picture of a name, with or without its folder and its ending.

        Raises: LabelFileError: no picture has the name, or more than one has.
        """
        wanted = PurePosixPath(named.replace("\\", "/"))
        is_named_whole = wanted.suffix.lower() in SUFFIXES
        stem = wanted.stem if is_named_whole else wanted.name
        found = self._found.get(stem) or self._found.get(UPLOAD.sub("", stem)) or []
        exact = [
            p for p in found if not is_named_whole or p.suffix.lower() == wanted.suffix.lower()
        ]
        found = exact or found
        for count in range(2, len(wanted.parts) + 1):
            if len(found) < 2:
                break
            tail = wanted.parts[-count:-1]
            found = [p for p in found if p.parts[-count:-1] == tail] or found
        if len(found) == 1:
            return found[0]
        places = ", ".join(str(folder) for folder in self._folders)
        raise LabelFileError(
            f"{named[:120]}: {len(found) or 'no'} picture{'s' if found else ''} of this name in "
            f"{places}; name the folder of the pictures with --images"
        )


def index_beside(file: Path) -> PictureIndex:
    """Index what lies beside a file of labels, and in a folder `images` one or two floors up."""
    folder = file.resolve().parent
    floors = (folder.parent / "images", folder.parent.parent / "images")
    there = [one for one in floors if one.is_dir() and one not in (folder, *folder.parents)]
    return PictureIndex((folder, *there))
