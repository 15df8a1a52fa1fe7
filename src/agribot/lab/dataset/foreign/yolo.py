"""YOLO segmentation: a text file for each picture, a line for each plant (docs.ultralytics.com).

A line is the number of the class and the corners in shares of width and height; the names of the
classes stand in another file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

from agribot.core.table_text import decode_text
from agribot.lab.dataset.foreign.shapes import (
    DrawnShape,
    LabelFileError,
    LabelledPicture,
    pair_numbers,
    read_shapes,
)
from agribot.ui.small_yaml import UnusableYaml, read_yaml

BOX_NUMBERS = 4
SURE_WORDS = 8  # a class, three corners and how sure the network was


def read_yolo(file: str, data: bytes, names: Mapping[int, str]) -> LabelledPicture:
    """Read the shapes of one picture; a class without a name is named by its number.

    Raises: LabelFileError: the file is no text.
    """
    try:
        lines = decode_text(data).split("\n")
    except ValueError as error:
        raise LabelFileError(f"is no text ({error})") from error
    found = [(number, line.split()) for number, line in enumerate(lines, 1) if line.strip()]
    extra = _count_extra([words for _, words in found], is_whole=len(found) > 1 or not lines[-1])
    read = partial(_read_numbered, file=file, names=names, extra=extra)
    return read_shapes(file, None, found, read)


def _count_extra(lines: Sequence[Sequence[str]], *, is_whole: bool) -> int:
    """Count the words behind the corners: how sure the network was, and the number of a track.

    Each line has them, or none. A file that ends amid a line was cut off.
    """
    if not is_whole or any(len(words) < SURE_WORDS for words in lines):
        return 0
    if all(not len(words) % 2 for words in lines):
        return 1
    tracks = [words[-1] for words in lines if len(words) % 2]
    has_tracks = len(tracks) == len(lines) and all(word.isdecimal() for word in tracks)
    return 2 if has_tracks and any(int(word) > 1 for word in tracks) else 0


def _read_numbered(
    line: tuple[int, list[str]], file: str, names: Mapping[int, str], extra: int
) -> DrawnShape:
    number, words = line
    try:
        return _read_words(words[: len(words) - extra], names)
    except LabelFileError as error:
        raise type(error)(f"{file}.txt, line {number}: {error}") from error


def _read_words(words: Sequence[str], names: Mapping[int, str]) -> DrawnShape:
    first, *numbers = words
    kind = _read_kind(first)
    if len(numbers) == BOX_NUMBERS + 1:
        raise LabelFileError(
            "a box and how sure the network was, or an odd count: it was cut off; export "
            "segmentations, with the corners of each plant"
        )
    if len(numbers) == BOX_NUMBERS:
        raise LabelFileError("a box; export segmentations, with the corners of each plant")
    polygon = pair_numbers(numbers)
    if polygon.min() < -0.01 or polygon.max() > 1.01:
        # In shares of the picture; the tolerance in pixels is applied once its size is known.
        raise LabelFileError(
            f"a corner at {polygon.max() if polygon.max() > 1.01 else polygon.min():g}, outside "
            "the picture, which goes from 0 to 1; are these pixels?"
        )
    return DrawnShape(name=names.get(kind, str(kind)), polygons=(polygon,))


def _read_kind(text: str) -> int:
    """Read the number of a class; numpy writes it as 1.0, or as 1.000000000000000000e+00."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (value >= 0.0 and value.is_integer()):
        raise LabelFileError(f"'{text[:20]}' is no number of a class")
    return int(value)


def read_names(file: str, data: bytes) -> dict[int, str]:
    """Read the names of the classes: `names:` of a YAML file, or a line for each class.

    Raises: LabelFileError: it is no such file.
    """
    if not file.endswith((".yaml", ".yml")):
        return _read_lines(data)
    try:
        value = read_yaml(data)
    except (UnusableYaml, ValueError) as error:
        raise LabelFileError(f"cannot be read: {error}") from error
    names = value.get("names") if isinstance(value, dict) else None
    if isinstance(names, list):
        return {i: str(name) for i, name in enumerate(names)}
    if isinstance(names, dict) and all(isinstance(key, int) for key in names):
        return {key: str(name) for key, name in names.items()}
    raise LabelFileError("has no list of 'names'")


def _read_lines(data: bytes) -> dict[int, str]:
    try:
        lines = decode_text(data).split("\n")
    except ValueError as error:
        raise LabelFileError(f"cannot be read: {error}") from error
    return {i: line.strip() for i, line in enumerate(lines) if line.strip()}
