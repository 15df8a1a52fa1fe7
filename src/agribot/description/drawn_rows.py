"""Crop rows of a generated field as a map draws them: the lines of a GeoJSON file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.geo import Datum, MapFrame
from agribot.core.geometries import list_geometries
from agribot.core.messages import FloatArray, Row
from agribot.core.table_text import read_text_file


def read_drawn_rows(path: Path, datum: Datum) -> list[FloatArray]:
    """Read the lines of kind `row`, or of none, in the map of `datum`: points (n, 2) each.

    Raises: DescriptionError: no such file, or no row in it.
    """
    frame = MapFrame(datum)
    try:
        tree = json.loads(read_text_file(path))
        lines = [
            np.array([frame.map_from_geodetic(at[1], at[0], datum.alt_m)[:2] for at in line])
            for line in _list_lines(tree)
        ]
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise DescriptionError(
            f"rows.file {path.name} is no GeoJSON that can be read: {error!r}; export it anew"
        ) from error
    if not lines or min(measure_line_m(line) for line in lines) <= 0.0:
        raise DescriptionError(
            f"rows.file {path.name} has no rows, or one without a length; draw them as LineStrings "
            "of kind 'row'"
        )
    return lines


def _list_lines(node: Any) -> Iterator[list[Any]]:
    for geometry, properties in list_geometries(node):
        kind = properties.get("kind") or "row"
        if geometry["type"] == "LineString" and kind == "row":
            yield geometry["coordinates"]


def measure_line_m(line: FloatArray) -> float:
    return float(np.sum(np.hypot(*np.diff(line, axis=0).T)))


def place_on_line(line: FloatArray, along_m: FloatArray) -> FloatArray:
    """Return the points (n, 2) at distances (n,) along a line (m, 2)."""
    ends_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    return np.stack([np.interp(along_m, ends_m, line[:, axis]) for axis in (0, 1)], axis=1)


def list_pieces(lines: list[FloatArray]) -> list[Row]:
    """List the straight pieces of lines, for what lies along rows."""
    pairs = [pair for line in lines for pair in pairwise(line.tolist())]
    return [
        Row(index=index, start_map_m=(a[0], a[1]), end_map_m=(b[0], b[1]))
        for index, (a, b) in enumerate(pairs)
    ]
