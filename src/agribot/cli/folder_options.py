"""The options --images and --masks of commands that read a set of images and masks."""

from __future__ import annotations

NAME_FOLDERS = "name them with --images and --masks"  # advice if the folders are not found


def list_given(name: str | None) -> tuple[str, ...]:
    """Return the folder that an option names, none where it is left out."""
    return () if name is None else (name,)
