"""What all labelling tools say: pictures, and shapes of named classes in them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from agribot.core.errors import AgribotError
from agribot.core.table_text import recode_text
from agribot.lab.dataset.pictures import LARGEST_PX

T = TypeVar("T")
Polygon = npt.NDArray[np.float64]  # (N, 2) of u right, v down, from the picture's top left corner
Mask = npt.NDArray[np.bool_]

LEAST_CORNERS = 3
EDGE_TOLERANCE_PX = 2.0  # distance beside the picture at which a click is taken for its edge
EDGE_TOLERANCE_RATIO = 0.005


class LabelFileError(AgribotError):
    """A file of labels, or what it says of one picture, cannot be used; the message says why."""


class NoAreaError(LabelFileError):
    """A shape covers no pixel, such as a click; it is left out, and its picture kept."""


class DrawnShape(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Plants of one class: the union of polygons, in pixels, or a mask of the whole picture.

    `mask` is unpacked when it is painted: those of a whole set are more than memory holds.
    """

    name: str
    polygons: tuple[Polygon, ...] = ()
    mask: Callable[[], Mask] | None = None


class LabelledPicture(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A picture as a tool names it; later shapes lie over earlier ones.

    `size_px` is (width, height); None: the tool does not say, and polygons are in shares of it.
    `problem` is why its shapes cannot be used, empty where they can. `left_out` says which of them
    cover nothing.
    """

    file: str
    size_px: tuple[int, int] | None
    shapes: tuple[DrawnShape, ...] = ()
    problem: str = ""
    left_out: tuple[str, ...] = ()


def read_shapes(
    file: str,
    size_px: tuple[int, int] | None,
    items: Iterable[T],
    read: Callable[[T], DrawnShape],
) -> LabelledPicture:
    """Read all shapes of a picture; one that covers nothing is left out by name."""
    shapes, left_out = [], []
    try:
        for item in items:
            try:
                shapes.append(read(item))
            except NoAreaError as error:
                left_out.append(str(error))
    except LabelFileError as error:
        return LabelledPicture(file=file, size_px=size_px, problem=str(error))
    return LabelledPicture(
        file=file, size_px=size_px, shapes=tuple(shapes), left_out=tuple(left_out)
    )


def decode_json(data: bytes) -> Any:
    """Decode JSON of any shape.

    Raises: LabelFileError: cut off, no JSON, or nested too deeply.
    """
    try:
        return msgspec.json.decode(recode_text(data))
    except (ValueError, RecursionError) as error:  # a DecodeError is a ValueError
        raise LabelFileError(f"is no whole JSON file ({error}); export it again") from error


def convert_json(value: Any, kind: type[T], tool: str) -> T:
    """Check decoded JSON against what a tool writes.

    Raises: LabelFileError: a field is missing, or of another type.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        raise LabelFileError(f"is no {tool} file ({error}); export it again") from error


def make_polygon(points: Sequence[Any]) -> Polygon:
    """Make a polygon of pairs of numbers.

    Raises: LabelFileError: no pairs of finite numbers. NoAreaError: they enclose nothing.
    """
    if len(points) < LEAST_CORNERS:
        raise NoAreaError(f"a polygon of {len(points)} points; draw at least {LEAST_CORNERS}")
    try:
        corners = np.array(points, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise LabelFileError(f"a polygon that is not of numbers: {_shorten(points)}") from error
    if corners.shape != (len(points), 2) or not np.isfinite(corners).all():
        raise LabelFileError(f"a polygon that is not of pairs of numbers: {_shorten(points)}")
    (u, v), (next_u, next_v) = corners.T, np.roll(corners, -1, axis=0).T
    if not (u * next_v - next_u * v).sum():
        raise NoAreaError(f"a polygon without an area: {_shorten(points)}")
    return corners


def pair_numbers(numbers: Sequence[Any]) -> Polygon:
    """Make a polygon of u, v, u, v and so on.

    Raises: LabelFileError: an odd count, as where a line was cut off.
    """
    if len(numbers) % 2:
        raise LabelFileError(f"a polygon of {len(numbers)} numbers, an odd count: it was cut off")
    return make_polygon([numbers[i : i + 2] for i in range(0, len(numbers), 2)])


def check_size(width_px: int, height_px: int) -> tuple[int, int]:
    """Check a size before anything of that size is made.

    Raises: LabelFileError: no picture is that large, or that small.
    """
    if min(width_px, height_px) < 1 or width_px * height_px > LARGEST_PX:
        raise LabelFileError(f"a picture of {width_px} x {height_px} pixels is impossible")
    return width_px, height_px


def fill_runs(counts: Sequence[int], shape: tuple[int, int], *, by_columns: bool) -> Mask:
    """Fill a mask (height, width) with runs of background, plant, background and so on.

    Raises: LabelFileError: the runs are not as long as the picture is large.
    """
    size = math.prod(shape)
    if any(count < 0 for count in counts) or sum(counts) != size:
        raise LabelFileError(
            f"run lengths of {sum(counts)} pixels in a mask of {shape[1]} x {shape[0]}: it was cut "
            "off, or belongs to another picture"
        )
    line = np.repeat(np.arange(len(counts)) % 2 == 1, counts)
    return line.reshape(shape[::-1]).T if by_columns else line.reshape(shape)


def check_inside(polygon: Polygon, size_px: tuple[int, int]) -> Polygon:
    """Clip a polygon that reaches a little over the edge.

    Raises: LabelFileError: it reaches further, so that it belongs to another picture or size.
    """
    size = np.array(size_px, np.float64)
    over = np.maximum(-polygon, polygon - size)
    if (over > np.maximum(EDGE_TOLERANCE_PX, EDGE_TOLERANCE_RATIO * size)).any():
        u_px, v_px = polygon[int(over.max(axis=1).argmax())]
        raise LabelFileError(
            f"a polygon reaches ({u_px:.0f}, {v_px:.0f}), outside the picture of {size_px[0]} x "
            f"{size_px[1]} pixels; fix it, or label the picture at the size it has"
        )
    return polygon.clip(0.0, size)


def _shorten(value: object) -> str:
    return json.dumps(value, default=str)[:60]
