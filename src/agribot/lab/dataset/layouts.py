"""Which image belongs to which mask, in the folder layouts that are known.

A set is a folder with a folder of images and one of masks; a collection is a folder of such
sets, one for each field or day. Files pair by name, without endings such as `_image` and `_mask`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import msgspec

from agribot.core.errors import ConfigError
from agribot.lab.dataset.pictures import SUFFIXES

IMAGE_FOLDERS = ("images/rgb", "images", "rgb")
MASK_FOLDERS = ("annotations/dlp/colorCleaned", "annotations", "masks", "labels")
ENDING = re.compile(r"[._-](image|img|rgb|mask|annotation|annotations|label|labels|gt)$")


class Item(msgspec.Struct, frozen=True, kw_only=True):
    """A pair of files, relative to the root of the set; a missing partner is None.

    `group` is the sub-folder of a collection, empty in a single set.
    """

    key: str
    group: str
    image: str | None
    mask: str | None


class Layout(msgspec.Struct, frozen=True, kw_only=True):
    root: Path
    items: tuple[Item, ...]
    doubles: tuple[str, ...]  # files whose name pairs with the same partner as another one's


def find_layout(root: Path, images: str | None = None, masks: str | None = None) -> Layout:
    """Pair the files below `root`; `images` and `masks` name the folders where a guess would fail.

    Raises: ConfigError: no such folder, or no folders of images and masks in it.
    """
    if not root.is_dir():
        raise ConfigError(f"{root} is no folder; check the path")
    items: list[Item] = []
    doubles: list[str] = []
    for group in (root, *sorted(path for path in root.iterdir() if path.is_dir())):
        image_folder = _find_first(group, (images,) if images else IMAGE_FOLDERS)
        mask_folder = _find_first(group, (masks,) if masks else MASK_FOLDERS)
        if image_folder is None or mask_folder is None:
            continue
        name = "" if group == root else group.name
        pictures, more = _index_files(root, image_folder)
        labels, others = _index_files(root, mask_folder)
        doubles += more + others
        items += (
            Item(key=key, group=name, image=pictures.get(key), mask=labels.get(key))
            for key in sorted(pictures.keys() | labels.keys())
        )
        if group == root:
            break
    if not items:
        raise ConfigError(
            f"{root} has no pair of folders with images ({images or ', '.join(IMAGE_FOLDERS)}) and "
            f"masks ({masks or ', '.join(MASK_FOLDERS)}); name them with --images and --masks"
        )
    return Layout(root=root, items=tuple(items), doubles=tuple(doubles))


def _find_first(group: Path, names: Sequence[str]) -> Path | None:
    return next((group / name for name in names if (group / name).is_dir()), None)


def _index_files(root: Path, folder: Path) -> tuple[dict[str, str], list[str]]:
    found: dict[str, str] = {}
    doubles = []
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() not in SUFFIXES:
            continue
        key = ENDING.sub("", path.relative_to(folder).with_suffix("").as_posix())
        name = path.relative_to(root).as_posix()
        if key in found:
            doubles.append(name)
        else:
            found[key] = name
    return found, doubles
