"""Label Studio: one JSON list of tasks (labelstud.io), polygons in percent and brush strokes."""

from __future__ import annotations

from functools import partial
from typing import Any
from urllib.parse import unquote

import msgspec
import numpy as np

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

_PLACES = {"points", "rle", "x", "vertices"}
_NO_AREA = {"keypointlabels", "keypoint", "vectorlabels", "vector"}
_SIDES = ({"width", "height"}, {"radiusX", "radiusY"})  # keys of boxes and ellipses
CHANNELS = 4  # channels of a stored brush stroke: red, green, blue and alpha


class _Value(msgspec.Struct):
    points: list[tuple[float, float]] | None = None
    polygonlabels: list[str] = []
    rle: list[int] | None = None
    brushlabels: list[str] = []


class _Result(msgspec.Struct):
    type: str
    value: Any = None
    original_width: int = 0
    original_height: int = 0


class _Annotation(msgspec.Struct):
    result: list[_Result] = []
    was_cancelled: bool = False


class _Task(msgspec.Struct):
    data: dict[str, Any]
    annotations: list[_Annotation]
    file_upload: str | None = None


def is_label_studio(value: Any) -> bool:
    return (
        isinstance(value, list)
        and bool(value)
        and isinstance(value[0], dict)
        and {"data", "annotations"} <= value[0].keys()
    )


def read_label_studio(value: Any) -> list[LabelledPicture]:
    """Read all pictures that somebody labelled; of several annotations the last one counts.

    Raises: LabelFileError: it is no such file.
    """
    tasks = convert_json(value, list[_Task], "Label Studio")
    pictures = []
    for task in tasks:
        done = [one for one in task.annotations if not one.was_cancelled]
        pictures.append(_read_picture(_find_file(task), done[-1].result if done else []))
    return pictures


def _find_file(task: _Task) -> str:
    if task.file_upload:
        return task.file_upload
    named = task.data.get("image") or next(
        (one for one in task.data.values() if isinstance(one, str)), ""
    )
    path, _, query = unquote(str(named)).partition("?")
    return query.partition("d=")[2] or path


def _read_picture(file: str, results: list[_Result]) -> LabelledPicture:
    drawn = [one for one in results if one.type != "labels" and _is_drawn(one.value)]
    if not drawn:
        return LabelledPicture(file=file, size_px=None)
    try:
        size_px = check_size(drawn[0].original_width, drawn[0].original_height)
    except LabelFileError as error:
        return LabelledPicture(file=file, size_px=None, problem=str(error))
    return read_shapes(file, size_px, drawn, partial(_read_shape, size_px=size_px))


def _is_drawn(value: Any) -> bool:
    """Return whether a result has a place: ratings, choices, texts and relations have none."""
    return isinstance(value, dict) and not _PLACES.isdisjoint(value)


def _read_shape(result: _Result, size_px: tuple[int, int]) -> DrawnShape:
    value = convert_json(result.value, _Value, "Label Studio")
    names = value.polygonlabels or value.brushlabels
    if result.type in _NO_AREA or _is_click(result.value):
        raise NoAreaError(f"a {result.type[:30]}")
    if result.type not in {"polygonlabels", "brushlabels"} or len(names) != 1:
        raise LabelFileError(
            f"a label of type {result.type[:30]} with {len(names)} classes; only polygons and "
            "brush strokes of one class say which pixels are plant"
        )
    if value.rle is not None:
        return DrawnShape(name=names[0], mask=partial(_fill_brush, value.rle, size_px))
    return DrawnShape(
        name=names[0],
        polygons=(make_polygon(value.points or []) * (np.array(size_px) / 100.0),),
    )


def _is_click(value: dict[str, Any]) -> bool:
    """Return whether a box or an ellipse has a side of zero."""
    return any(sides <= value.keys() and 0 in map(value.get, sides) for sides in _SIDES)


def _fill_brush(rle: list[int], size_px: tuple[int, int]) -> Mask:
    """Unpack a brush stroke (rle-pack of thi.ng, as Label Studio's converter reads it).

    Raises: LabelFileError: cut off, or not as large as the picture.
    """
    width, height = size_px
    try:
        bits = _Bits(bytes(rle))
        size = bits.take(32)
        if size != width * height * CHANNELS:
            raise LabelFileError(f"a brush stroke of {size} values in {width} x {height} pixels")
        word_bits = bits.take(5) + 1
        length_bits = [bits.take(4) + 1 for _ in range(4)]
        values = np.zeros(size, np.uint8)
        place = 0
        while place < size:
            is_run = bits.take(1)
            length = 1 + bits.take(length_bits[bits.take(2)])
            if is_run:
                values[place : place + length] = bits.take(word_bits) & 255
            else:
                words = [bits.take(word_bits) & 255 for _ in range(min(length, size - place))]
                values[place : place + length] = words
            place += length
    except ValueError as error:
        raise LabelFileError("a brush stroke that was cut off") from error
    return values.reshape(height, width, CHANNELS)[..., CHANNELS - 1] > 0


class _Bits:
    """Numbers of any count of bits, one after the other."""

    def __init__(self, data: bytes) -> None:
        self._bits = np.unpackbits(np.frombuffer(data, np.uint8)).tobytes().translate(_DIGITS)
        self._place = 0

    def take(self, count: int) -> int:
        """Take the next number.

        Raises: ValueError: fewer than `count` bits are left.
        """
        end = self._place + count
        if end > len(self._bits):
            raise ValueError("no more bits")
        number = int(self._bits[self._place : end], 2)
        self._place = end
        return number


_DIGITS = bytes.maketrans(b"\x00\x01", b"01")
