"""YOLO segmentation: a text file for each picture, a line for each plant (docs.ultralytics.com).

A line is the number of the class and the corners in shares of width and height; the names of the
classes stand in another file.
"""

from __future__ import annotations

from collections.abc import Mapping

from agribot.core.table_text import decode_text
from agribot.lab.dataset.foreign.shapes import (
    DrawnShape,
    LabelFileError,
    LabelledPicture,
    pair_numbers,
)
from agribot.ui.small_yaml import UnusableYaml, read_yaml

BOX_NUMBERS = 4


def read_yolo(file: str, data: bytes, names: Mapping[int, str]) -> LabelledPicture:
    """Read the shapes of one picture; a class without a name is named by its number.

    Raises: LabelFileError: the file is no text.
    """
    try:
        lines = decode_text(data).split("\n")
    except ValueError as error:
        raise LabelFileError(f"is no text ({error})") from error
    shapes = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            shapes.append(_read_line(line, names))
        except LabelFileError as error:
            return LabelledPicture(
                file=file, size_px=None, problem=f"{file}.txt, line {number}: {error}"
            )
    return LabelledPicture(file=file, size_px=None, shapes=tuple(shapes))


def _read_line(line: str, names: Mapping[int, str]) -> DrawnShape:
    first, *words = line.split()
    if not first.isascii() or not first.isdigit():
        raise LabelFileError(f"'{first[:20]}' is no number of a class")
    if len(words) == BOX_NUMBERS:
        raise LabelFileError("a box; export segmentations, with the corners of each plant")
    polygon = pair_numbers(words)
    if polygon.min() < -0.01 or polygon.max() > 1.01:
        # In shares of the picture; the tolerance in pixels is applied once its size is known.
        raise LabelFileError(
            f"a corner at {polygon.max() if polygon.max() > 1.01 else polygon.min():g}, outside "
            "the picture, which goes from 0 to 1; are these pixels?"
        )
    return DrawnShape(name=names.get(int(first), first), polygons=(polygon,))


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
