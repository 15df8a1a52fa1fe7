"""LabelMe: one JSON file for each picture (github.com/wkentaro/labelme, file version 5)."""

from __future__ import annotations

import base64
import binascii
import io
from functools import partial
from typing import Any

import msgspec
import numpy as np
from PIL import Image

from agribot.lab.dataset.foreign.shapes import (
    DrawnShape,
    LabelFileError,
    LabelledPicture,
    Mask,
    NoAreaError,
    check_size,
    convert_json,
    make_polygon,
    read_shapes,
)

_NO_AREA = {"point", "points", "line", "linestrip"}
_OF_TWO_POINTS = {"rectangle", "circle"}


class _Shape(msgspec.Struct):
    label: str
    points: list[tuple[float, float]]
    shape_type: str | None = "polygon"
    mask: str | None = None


class _File(msgspec.Struct, rename="camel"):
    shapes: list[_Shape]
    image_path: str
    image_height: int
    image_width: int


def is_labelme(value: Any) -> bool:
    return isinstance(value, dict) and "shapes" in value and "imagePath" in value


def read_labelme(value: Any) -> list[LabelledPicture]:
    """Read the one picture of a file.

    Raises: LabelFileError: it is no such file.
    """
    file = convert_json(value, _File, "LabelMe")
    size_px = check_size(file.image_width, file.image_height)
    read = partial(_read_shape, size_px=size_px)
    return [read_shapes(file.image_path, size_px, file.shapes, read)]


def _read_shape(shape: _Shape, size_px: tuple[int, int]) -> DrawnShape:
    if shape.shape_type == "mask" and shape.mask is not None:
        return DrawnShape(
            name=shape.label, mask=partial(_read_mask, shape.mask, shape.points, size_px)
        )
    if shape.shape_type in _NO_AREA or _is_click(shape):
        raise NoAreaError(f"'{shape.label}' is a {shape.shape_type}")
    if shape.shape_type not in {"polygon", None}:
        raise LabelFileError(
            f"'{shape.label}' is a {shape.shape_type}; only polygons and masks say which pixels "
            "are plant"
        )
    return DrawnShape(name=shape.label, polygons=(make_polygon(shape.points),))


def _is_click(shape: _Shape) -> bool:
    """Return whether a box has no width or no height, or a circle no radius."""
    if shape.shape_type not in _OF_TWO_POINTS or len(shape.points) != 2:
        return False
    (u, v), (other_u, other_v) = shape.points
    sides = abs(u - other_u), abs(v - other_v)
    return not (max(sides) if shape.shape_type == "circle" else min(sides))


def _read_mask(text: str, points: list[tuple[float, float]], size_px: tuple[int, int]) -> Mask:
    """Read a mask that fills the box from the first point to the second, both included."""
    try:
        with Image.open(io.BytesIO(base64.b64decode(text, validate=True))) as image:
            if image.width > size_px[0] or image.height > size_px[1]:
                raise LabelFileError(f"a mask of {image.width} x {image.height} is too large")
            part = np.asarray(image.convert("L")) > 0
    except (
        OSError,
        SyntaxError,
        ValueError,
        binascii.Error,
        Image.DecompressionBombError,
    ) as error:
        raise LabelFileError(f"a mask that is no picture ({error})") from error
    if len(points) != 2:
        raise LabelFileError("a mask whose place is not two points")
    left, top = (round(min(axis)) for axis in zip(*points, strict=True))
    height, width = part.shape
    if left < 0 or top < 0 or left + width > size_px[0] or top + height > size_px[1]:
        raise LabelFileError("a mask that reaches out of the picture")
    mask = np.zeros(size_px[::-1], bool)
    mask[top : top + height, left : left + width] = part
    return mask
