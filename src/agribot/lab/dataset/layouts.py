"""Which image belongs to which mask, in the folder layouts that are known.

A set is a folder with a folder of images and one of masks; a collection is a folder of such
sets, one for each field or day. Files pair by name, without endings such as `_image` and `_mask`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from agribot.core.errors import ConfigError
from agribot.lab.dataset.pictures import MISNAMED, SUFFIXES, is_text, show_name

IMAGE_FOLDERS = ("images/rgb", "images", "rgb")
BONN_MASKS = ("annotations/dlp/colorCleaned", "annotations/dlp/color")
MASK_FOLDERS = (*BONN_MASKS, "annotations", "masks", "labels")
ADVICE = "call your folders so, or link them"
ENDING = re.compile(r"[._-](image|img|rgb|mask|annotation|annotations|label|labels|gt)$")


class Item(msgspec.Struct, frozen=True, kw_only=True):
    """A pair of files, relative to the root of the set; a missing partner is None.

    `group` is the sub-folder of a collection, empty in a single set.
    """

    key: str
    group: str
    image: str | None
    mask: str | None


class UnusedFile(NamedTuple):
    """A file that belongs to no item: why, and its name as any text can hold it."""

    reason: str
    file: str


class Layout(msgspec.Struct, frozen=True, kw_only=True):
    root: Path
    items: tuple[Item, ...]
    left_out: tuple[UnusedFile, ...]


def find_layout(
    root: Path,
    images: Sequence[str] = IMAGE_FOLDERS,
    masks: Sequence[str] = MASK_FOLDERS,
    advice: str = ADVICE,
) -> Layout:
    """Pair the files below `root`, in the first folders of `images` and `masks` that exist.

    `advice` says what to do where none does.

    Raises: ConfigError: no such folder, or no folders of images and masks in it.
    """
    if not root.is_dir():
        raise ConfigError(f"{root} is no folder; check the path")
    items: list[Item] = []
    left_out: list[UnusedFile] = []
    for group in (root, *sorted(path for path in root.iterdir() if path.is_dir())):
        image_folder = _find_first(group, images)
        mask_folder = _find_first(group, masks)
        if image_folder is None or mask_folder is None:
            continue
        name = "" if group == root else group.name
        pictures, more = index_files(root, image_folder)
        labels, others = index_files(root, mask_folder)
        left_out += more + others
        items += (
            Item(key=key, group=name, image=pictures.get(key), mask=labels.get(key))
            for key in sorted(pictures.keys() | labels.keys())
        )
        if group == root:
            break
    if left_out and not items:
        raise ConfigError(f"{root}: no file can be used; {left_out[0].reason}: {left_out[0].file}")
    if not items:
        raise ConfigError(
            f"{root} has no pair of folders with images ({', '.join(images)}) and masks "
            f"({', '.join(masks)}); {advice}"
        )
    return Layout(root=root, items=tuple(items), left_out=tuple(left_out))


def _find_first(group: Path, names: Sequence[str]) -> Path | None:
    return next((group / name for name in names if (group / name).is_dir()), None)


def index_files(root: Path, folder: Path) -> tuple[dict[str, str], list[UnusedFile]]:
    """Index the pictures in a folder by their keys, their names relative to `root`.

    The second list holds those that cannot be used.
    """
    found: dict[str, str] = {}
    left_out = []
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() not in SUFFIXES:
            continue
        key = ENDING.sub("", path.relative_to(folder).with_suffix("").as_posix())
        name = path.relative_to(root).as_posix()
        if not is_text(name):
            left_out.append(UnusedFile(MISNAMED, show_name(name)))
        elif key in found:
            left_out.append(UnusedFile("two files of one name", name))
        else:
            found[key] = name
    return found, left_out
