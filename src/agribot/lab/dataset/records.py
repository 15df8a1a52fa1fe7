"""What is written down beside each generated image, and where its files lie.

A folder holds `dataset.json` (what it was drawn from), one PNG or JPEG for each image, one PNG
for each kind of label, and `records/NNNNNN.json`, which is written last: an image whose record
exists is complete.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import msgspec

from agribot.core.errors import OTHER_OUT, ConfigError, RecordingError, explain_os_error
from agribot.core.version import __version__
from agribot.core.whole_file import write_at_once

ABOUT = "dataset.json"
LABELS = ("masks", "instances", "depth")
COLOURED = "colour"


class Recipe(msgspec.Struct, frozen=True, kw_only=True):
    """Image k of a recipe is always the same, however many are drawn and by how many workers."""

    seed: int = 0
    width_px: int = 640
    height_px: int = 480
    supersample: int = 2
    views_per_field: int = 8
    format: Literal["png", "jpg"] = "png"
    colour_masks: bool = False
    variety: Literal["standard", "wide", "seedlings"] = "standard"
    version: str = __version__


class SeenPlant(msgspec.Struct, frozen=True, kw_only=True):
    """A plant of the field as far as an image shows it.

    `instance` is its value in the instance mask, `bbox_px` is (left, top, width, height), and
    `rle` lists the mask's run lengths down the columns, as COCO counts them, compressed.
    """

    instance: int
    species: str
    plant: Literal["weed", "crop"]
    bbox_px: tuple[int, int, int, int]
    area_px: int
    x_map_m: float
    y_map_m: float
    size_m: float
    rle: str


class ImageRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One image. The camera is a pinhole: x right, y down, z forward; pixel centres are whole."""

    index: int
    field: int
    width_px: int
    height_px: int
    focal_px: float
    cx_px: float
    cy_px: float
    map_from_camera: tuple[tuple[float, ...], ...]
    plants: tuple[SeenPlant, ...]


def stem(index: int) -> str:
    return f"{index:06d}"


def image_name(recipe: Recipe, index: int) -> str:
    """Return the path of an image inside the data set."""
    return f"images/{stem(index)}.{recipe.format}"


def record_path(folder: Path, index: int) -> Path:
    return folder / "records" / f"{stem(index)}.json"


def folders(recipe: Recipe) -> tuple[str, ...]:
    return ("images", *LABELS, *((COLOURED,) if recipe.colour_masks else ()), "records")


def claim(folder: Path, recipe: Recipe) -> None:
    """Make the folders of a data set, or check that those there are of the same recipe.

    Raises: ConfigError: the folder holds something else. RecordingError: it cannot be written.
    """
    about = folder / ABOUT
    with explain_os_error(f"cannot write into {folder}", OTHER_OUT):
        for name in folders(recipe):
            (folder / name).mkdir(parents=True, exist_ok=True)
        if not about.is_file():
            write_at_once(about, encode(recipe))
    found = read_recipe(folder)
    differing = [
        f"{name} {getattr(found, name)}, not {getattr(recipe, name)}"
        for name in Recipe.__struct_fields__
        if getattr(found, name) != getattr(recipe, name)
    ]
    if differing:
        raise ConfigError(
            f"{folder} holds images with {', '.join(differing)}; give the same options again or "
            "another --out folder"
        )


def read_recipe(folder: Path) -> Recipe:
    """Read `dataset.json`.

    Raises: RecordingError: `dataset.json` is missing or broken.
    """
    path = folder / ABOUT
    try:
        return msgspec.json.decode(path.read_bytes(), type=Recipe)
    except (OSError, msgspec.MsgspecError) as error:
        raise RecordingError(f"cannot read {path}: {error}; draw into another folder") from error


def read_records(folder: Path) -> Iterator[ImageRecord]:
    """Read the records of all complete images, in order.

    Raises: RecordingError: a record is broken.
    """
    for path in sorted((folder / "records").glob("*.json")):
        try:
            yield msgspec.json.decode(path.read_bytes(), type=ImageRecord)
        except msgspec.MsgspecError as error:
            raise RecordingError(
                f"{path} is no image record ({error}); delete it and draw again"
            ) from error


def encode(value: object) -> bytes:
    return msgspec.json.encode(value) + b"\n"
