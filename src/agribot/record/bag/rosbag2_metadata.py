"""What `metadata.yaml` of a rosbag2 folder says of its files.

Source: rosbag2_storage, versions 1 to 9 of the file.
"""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import Any

import msgspec

from agribot.core.errors import RecordingError

NAME = "metadata.yaml"


class Rosbag2Metadata(msgspec.Struct, frozen=True, kw_only=True):
    """`is_packed`: each message is a zstd frame of its own, which the files do not state."""

    files: tuple[str, ...]
    messages: int | None
    is_packed: bool


def read_metadata(folder: Path) -> Rosbag2Metadata | None:
    """Read the file; None where it is missing or damaged.

    Raises: RecordingError: its messages are compressed in a way that is not read.
    """
    about = _load(folder / NAME)
    if about is None:
        return None
    is_packed = str(about.get("compression_mode", "")).lower() == "message"
    packing = str(about.get("compression_format", "")) or "none"
    if is_packed and packing != "zstd":
        raise RecordingError(
            f"{folder}: its messages are compressed with {packing}; only zstd is read"
        )
    paths = about.get("relative_file_paths")
    count = about.get("message_count")
    return Rosbag2Metadata(
        files=tuple(PurePath(str(path)).name for path in paths) if isinstance(paths, list) else (),
        messages=count if isinstance(count, int) else None,
        is_packed=is_packed,
    )


def _load(path: Path) -> dict[str, Any] | None:
    from ruamel.yaml import YAML

    try:
        about = YAML(typ="safe").load(path.read_text("utf-8", "replace"))
        found = about["rosbag2_bagfile_information"]
    except Exception:  # noqa: BLE001  damaged bytes give errors of any kind
        return None
    return found if isinstance(found, dict) else None
