"""CVAT: one XML file for a task, "CVAT for images 1.1" (docs.cvat.ai)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import partial

import numpy as np

from agribot.gis.formats.untrusted import parse_xml
from agribot.lab.dataset.foreign.shapes import (
    DrawnShape,
    LabelFileError,
    LabelledPicture,
    Mask,
    NoAreaError,
    check_size,
    fill_runs,
    make_polygon,
    read_shapes,
)

NO_AREA = {"polyline", "points", "skeleton"}
NO_OUTLINE = {"box", "cuboid", "ellipse"}
BOX_SIDES = ("xtl", "xbr"), ("ytl", "ybr")


def read_cvat(data: bytes) -> list[LabelledPicture]:
    """Read all pictures of a file.

    Raises: LabelFileError: it is no such file, cut off, or has entities of its own.
    """
    try:
        root = parse_xml(data)
    except ValueError as error:
        raise LabelFileError(f"is no whole CVAT file ({error}); export it again") from error
    if root.tag != "annotations":
        raise LabelFileError(f"is no CVAT file: it begins with <{root.tag[:40]}>")
    if root.find("track") is not None:
        raise LabelFileError("holds tracks of a video; export it as 'CVAT for images 1.1'")
    return [_read_picture(image) for image in root.iter("image")]


def _read_picture(image: ET.Element) -> LabelledPicture:
    file = image.get("name", "")
    try:
        size_px = check_size(_read_int(image, "width"), _read_int(image, "height"))
        ordered = sorted(
            (e for e in image if e.tag != "tag"), key=lambda e: int(e.get("z_order", 0))
        )
    except LabelFileError as error:
        return LabelledPicture(file=file, size_px=None, problem=str(error))
    except ValueError as error:
        return LabelledPicture(file=file, size_px=None, problem=f"z_order: {error}")
    return read_shapes(file, size_px, ordered, partial(_read_shape, size_px=size_px))


def _read_shape(element: ET.Element, size_px: tuple[int, int]) -> DrawnShape:
    name = element.get("label", "")
    if element.tag == "polygon":
        points = [point.split(",") for point in element.get("points", "").split(";") if point]
        return DrawnShape(name=name, polygons=(make_polygon(points),))
    if element.tag == "mask":
        return DrawnShape(name=name, mask=partial(_read_mask, element, size_px))
    if element.tag in NO_AREA or _is_click(element):
        raise NoAreaError(f"'{name}' is a {element.tag}")
    what = element.tag if element.tag in NO_OUTLINE else f"<{element.tag[:20]}>"
    raise LabelFileError(
        f"'{name}' is a {what}; only polygons and masks say which pixels are plant"
    )


def _is_click(element: ET.Element) -> bool:
    """Return whether a box has no width or no height."""
    sides = [(element.get(low), element.get(high)) for low, high in BOX_SIDES]
    return element.tag == "box" and any(low is not None and low == high for low, high in sides)


def _read_mask(element: ET.Element, size_px: tuple[int, int]) -> Mask:
    """Read a mask of run lengths by rows, beginning with background, in a box of its own."""
    left, top, width, height = (_read_int(element, n) for n in ("left", "top", "width", "height"))
    is_inside = min(left, top) >= 0 and left + width <= size_px[0] and top + height <= size_px[1]
    if min(width, height) < 1 or not is_inside:
        raise LabelFileError("a mask that reaches out of the picture")
    try:
        counts = [int(text) for text in element.get("rle", "").split(",")]
    except ValueError as error:
        raise LabelFileError(f"a mask whose run lengths are no numbers ({error})") from error
    mask = np.zeros(size_px[::-1], bool)
    part = fill_runs(counts, (height, width), by_columns=False)
    mask[top : top + height, left : left + width] = part
    return mask


def _read_int(element: ET.Element, name: str) -> int:
    try:
        return int(element.get(name, ""))
    except ValueError as error:
        raise LabelFileError(f"<{element.tag}> has no whole number '{name}'") from error
