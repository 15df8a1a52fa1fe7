"""Names of the results of pictures and videos: each file has its own."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from pathlib import Path

from agribot.cli.data.videos import VIDEO_SUFFIXES

_FRAME = re.compile(r"(.+)-\d{6,}", re.DOTALL)  # VIDEO-000123


def name_results(files: Sequence[Path]) -> list[str]:
    """Name the results of each file, so that no two files have one of the same name.

    Those of a video carry the number of the frame behind its name, which a picture may have too.
    """
    names: list[str] = []
    pictures: set[str] = set()
    videos: set[str] = set()
    for file in files:
        name, is_film = file.stem, is_video(file)
        while (
            name in pictures | videos
            or (not is_film and _strip_frame(name) in videos)
            or (is_film and any(_strip_frame(other) == name for other in pictures))
        ):
            name += "_"
        (videos if is_film else pictures).add(name)
        names.append(name)
    return names


def is_video(file: Path) -> bool:
    return file.suffix.lower() in VIDEO_SUFFIXES


def _strip_frame(name: str) -> str:
    """Return the name of the video whose frame has this name; empty where no frame has it."""
    found = _FRAME.fullmatch(name)
    return found[1] if found else ""


def list_frames(out: Path, video: str) -> list[str]:
    """List the names that frames of a video have among the files that are there."""
    there = (path.stem.rpartition("-")[0] for path in out.glob(f"{glob.escape(video)}-*-*"))
    return sorted({name for name in there if _strip_frame(name) == video})
