"""The outlines of the cells of an occupancy map, as areas without holes."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from agribot.core.errors import DescriptionError
from agribot.core.messages import FloatArray
from agribot.description.ros_map import RosMap

if TYPE_CHECKING:
    import shapely
    from shapely.geometry.base import BaseGeometry

Ring = tuple[tuple[float, float], ...]
MOST_RUNS = 50_000  # runs of cells in a line
MOST_CORNERS = 20_000  # corners of all areas together


def outline_cells(ros_map: RosMap, states: Collection[int]) -> tuple[Ring, ...]:
    """Draw the areas that cells of these states cover, in the map; (n) rings of corners.

    An area holds its cells whole and reaches at most a cell beyond them. One with a hole is cut
    into pieces, so that a wall around a yard leaves the yard free.
    Raises: DescriptionError: more cells or corners than can be planned with.
    """
    import shapely

    is_taken = np.isin(ros_map.cells, list(states))
    if not is_taken.any():
        return ()
    half_m = ros_map.resolution_m / 2.0
    boxes = shapely.box(*_find_runs(is_taken, ros_map).T)
    grown = shapely.union_all(boxes).buffer(half_m, join_style="mitre").simplify(half_m)
    corners = int(shapely.get_num_coordinates(grown))
    if corners > MOST_CORNERS:
        raise DescriptionError(
            f"the occupied cells have outlines of {corners} corners > {MOST_CORNERS}; remove "
            "specks or choose larger cells"
        )
    return tuple(_place(piece, ros_map) for piece in _cut_at_holes(grown))


def _find_runs(is_taken: npt.NDArray[np.bool_], ros_map: RosMap) -> FloatArray:
    """Return the boxes of neighbouring cells in a line, (n, 4): x and y of two corners, m."""
    edges = np.diff(np.pad(is_taken.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, start = np.nonzero(edges == 1)
    _, end = np.nonzero(edges == -1)
    if len(row) > MOST_RUNS:
        raise DescriptionError(
            f"the map has {len(row)} stretches of occupied cells > {MOST_RUNS}; remove specks or "
            "choose larger cells"
        )
    cells = np.stack([start, row, end, row + 1], axis=1).astype(np.float64)
    boxes: FloatArray = cells * ros_map.resolution_m
    return boxes


def _cut_at_holes(shape: BaseGeometry) -> list[shapely.Polygon]:
    """Cut areas with holes through the middle of a hole until none has one."""
    import shapely

    whole, left = [], list(shapely.get_parts(shape).tolist())
    while left:
        part = left.pop()
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        if not part.interiors:
            whole.append(part)
            continue
        west_m, south_m, east_m, north_m = part.bounds
        hole = shapely.Polygon(part.interiors[0]).bounds
        middle_m = (hole[0] + hole[2]) / 2.0
        for half in ((west_m, middle_m), (middle_m, east_m)):
            side = shapely.box(half[0], south_m, half[1], north_m)
            left += shapely.get_parts(part.intersection(side)).tolist()
    return whole


def _place(piece: shapely.Polygon, ros_map: RosMap) -> Ring:
    """Turn and move a piece from the cells' frame into the map; without its last point."""
    xy = np.array(piece.exterior.coords)[:-1]
    cos, sin = np.cos(ros_map.yaw_rad), np.sin(ros_map.yaw_rad)
    x_m = ros_map.x_min_m + cos * xy[:, 0] - sin * xy[:, 1]
    y_m = ros_map.y_min_m + sin * xy[:, 0] + cos * xy[:, 1]
    placed = np.round(np.stack([x_m, y_m], axis=1), 4).tolist()
    return tuple((x, y) for x, y in placed)
