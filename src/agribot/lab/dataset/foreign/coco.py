"""COCO: one JSON file for a whole set, with polygons or run lengths (cocodataset.org)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from functools import partial
from typing import Any

import msgspec

from agribot.lab.dataset.foreign.shapes import (
    DrawnShape,
    LabelFileError,
    LabelledPicture,
    Mask,
    NoAreaError,
    Polygon,
    check_size,
    convert_json,
    fill_runs,
    pair_numbers,
    read_shapes,
)
from agribot.lab.dataset.run_lengths import decompress

BOX_NUMBERS = 4


class _Image(msgspec.Struct):
    id: int | str
    file_name: str
    width: int
    height: int


class _Annotation(msgspec.Struct):
    image_id: int | str
    category_id: int
    segmentation: Any = None
    bbox: Any = None


class _Category(msgspec.Struct):
    id: int
    name: str


class _File(msgspec.Struct):
    images: list[_Image]
    annotations: list[_Annotation]
    categories: list[_Category]


class _RunLengths(msgspec.Struct):
    size: tuple[int, int]
    counts: str | list[int]


def is_coco(value: Any) -> bool:
    return isinstance(value, dict) and {"images", "annotations"} <= value.keys()


def read_coco(value: Any) -> list[LabelledPicture]:
    """Read all pictures of a file.

    Raises: LabelFileError: it is no such file, names a picture or class that it does not have, or
    gives one number to two of them.
    """
    file = convert_json(value, _File, "COCO")
    _check_numbers("image", [(image.id, image.file_name) for image in file.images])
    _check_numbers("category", [(category.id, category.name) for category in file.categories])
    names = {category.id: category.name for category in file.categories}
    known = {image.id for image in file.images}
    found: defaultdict[int | str, list[_Annotation]] = defaultdict(list)
    for annotation in file.annotations:
        if annotation.image_id not in known or annotation.category_id not in names:
            raise LabelFileError(
                f"has a label of image {annotation.image_id} and category {annotation.category_id},"
                " which it does not list; it was cut off or put together wrongly"
            )
        found[annotation.image_id].append(annotation)
    return [_read_picture(image, found[image.id], names) for image in file.images]


def _check_numbers(what: str, named: Iterable[tuple[int | str, str]]) -> None:
    """Refuse two pictures or classes with one number: their labels would be ambiguous.

    Raises: LabelFileError.
    """
    names: dict[int | str, str] = {}
    for number, name in named:
        if names.setdefault(number, name) != name:
            raise LabelFileError(
                f"has two of {what} {number}, {names[number]} and {name}: it was put together "
                "wrongly; import the parts one by one, or number them anew"
            )


def _read_picture(
    image: _Image, annotations: list[_Annotation], names: dict[int, str]
) -> LabelledPicture:
    try:
        size_px = check_size(image.width, image.height)
    except LabelFileError as error:
        return LabelledPicture(file=image.file_name, size_px=None, problem=str(error))
    return read_shapes(
        image.file_name,
        size_px,
        annotations,
        lambda one: _read_shape(one, names[one.category_id], size_px),
    )


def _read_shape(annotation: _Annotation, name: str, size_px: tuple[int, int]) -> DrawnShape:
    outline = annotation.segmentation
    if isinstance(outline, dict):
        runs = convert_json(outline, _RunLengths, "COCO")
        height, width = runs.size
        if (width, height) != size_px:
            raise LabelFileError(
                f"'{name}' has run lengths for {width} x {height} pixels, the picture is "
                f"{size_px[0]} x {size_px[1]}"
            )
        return DrawnShape(name=name, mask=partial(_fill, runs))
    if not isinstance(outline, list) or not all(isinstance(part, list) for part in outline):
        outline = []
    if not outline and _is_box(annotation.bbox):
        raise LabelFileError(f"'{name}' is a box without an outline; export segmentations")
    return DrawnShape(name=name, polygons=tuple(_pair_parts(outline, name)))


def _is_box(bbox: Any) -> bool:
    """Return whether a shape without an outline may be a box: not one of size 0."""
    is_list = isinstance(bbox, list) and len(bbox) == BOX_NUMBERS
    return not is_list or all(isinstance(side, int | float) and side > 0 for side in bbox[2:])


def _pair_parts(outline: list[Any], name: str) -> list[Polygon]:
    """Pair the corners of the parts that cover something.

    Raises: NoAreaError: none does.
    """
    found, reason = [], "an empty outline"
    for part in outline:
        try:
            found.append(pair_numbers(part))
        except NoAreaError as error:
            reason = str(error)
    if not found:
        raise NoAreaError(f"'{name}' is {reason}")
    return found


def _fill(runs: _RunLengths) -> Mask:
    try:
        counts = decompress(runs.counts) if isinstance(runs.counts, str) else runs.counts
    except ValueError as error:
        raise LabelFileError(f"run lengths that cannot be read: {error}") from error
    return fill_runs(counts, runs.size, by_columns=True)
