"""Parallel swaths over an area: their direction, their ends, and the cells they form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from agribot.core.messages import FloatArray

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

ANGLE_STEP_DEG = 1.0
MAX_PRODUCTS = 4_000_000  # edges and directions computed at once: 32 MB
SHORTEST_M = 0.01


class Swath(NamedTuple):
    """A swath in the swath frame: line number, distance across, and both ends along.

    `before_m` and `after_m` are how far the robot can drive on straight beyond both ends.
    """

    line: int
    v_m: float
    start_m: float
    end_m: float
    before_m: float = 0.0
    after_m: float = 0.0


def search_yaw_rad(work: BaseGeometry, spacing_m: float) -> float:
    """Search the direction that needs the fewest swaths, so the fewest turns, in (-pi/2, pi/2].

    Swaths are counted without drawing them: every edge of the area cuts |its extent across| /
    spacing lines, and each swath has two ends. The least lies at the direction of an edge.
    """
    edges = _list_edges(work)
    directions = np.concatenate(
        [np.arctan2(edges[:, 1], edges[:, 0]), np.radians(np.arange(0.0, 180.0, ANGLE_STEP_DEG))]
    )
    at_once = max(1, MAX_PRODUCTS // len(edges))
    blocks = np.split(directions, range(at_once, len(directions), at_once))
    across = np.concatenate([_measure_across_m(edges, block) for block in blocks])
    # Among directions that need as many swaths the first counts, whatever the rounding says.
    best = directions[int(np.argmin(np.round(across / (2.0 * spacing_m), 6)))]
    yaw_rad = math.remainder(float(best), math.pi)
    return yaw_rad + math.pi if yaw_rad <= -math.pi / 2.0 else yaw_rad


def _measure_across_m(edges: FloatArray, directions: FloatArray) -> FloatArray:
    """Measure the extent of all edges together across each direction."""
    products = edges[:, 1, None] * np.cos(directions) - edges[:, 0, None] * np.sin(directions)
    summed: FloatArray = np.abs(products).sum(axis=0)
    return summed


def _list_edges(work: BaseGeometry) -> FloatArray:
    import shapely

    parts = shapely.get_parts(work)
    rings = [ring for part in parts for ring in (part.exterior, *part.interiors)]
    return np.concatenate([np.diff(shapely.get_coordinates(ring), axis=0) for ring in rings])


def rotate(xy: FloatArray, yaw_rad: float) -> FloatArray:
    """Turn points (N, 2) of a frame at `yaw_rad` into the map; the negative leads back."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.asarray(xy @ np.array([[cos, sin], [-sin, cos]]))


def lay_swaths(
    work: BaseGeometry,
    drivable: BaseGeometry,
    yaw_rad: float,
    spacing_m: float,
    anchor_m: float | None,
) -> list[Swath]:
    """Lay swaths that together cover all of `work`, their centre lines inside `drivable`.

    `anchor_m`: one line lies at this distance across (an AB line); otherwise the lines are
    spread evenly, no farther apart than `spacing_m`.
    """
    import shapely

    turned = shapely.transform(work, lambda xy: rotate(xy, -yaw_rad))
    free = shapely.transform(drivable, lambda xy: rotate(xy, -yaw_rad))
    u0, v0, u1, v1 = turned.bounds
    lines_m, pitch_m = _list_lines(v0, v1, spacing_m, anchor_m)
    half_m = pitch_m / 2.0
    shapely.prepare(turned)
    boxes = [shapely.box(u0 - 1, v - half_m, u1 + 1, v + half_m) for v in lines_m.tolist()]
    stripes = np.asarray(shapely.intersection(turned, np.array(boxes)))
    ends = np.array([[[u0 - 1, v], [u1 + 1, v]] for v in lines_m])
    open_lines = np.asarray(shapely.intersection(free, np.asarray(shapely.linestrings(ends))))
    return [
        Swath(number, float(v_m), start_m, end_m)
        for number, v_m in enumerate(lines_m)
        for start_m, end_m in _clip(_join_spans(stripes[number]), _join_spans(open_lines[number]))
    ]


def _list_lines(
    v0: float, v1: float, spacing_m: float, anchor_m: float | None
) -> tuple[FloatArray, float]:
    if anchor_m is None:
        count = max(1, math.ceil((v1 - v0) / spacing_m - 1e-9))
        pitch_m = (v1 - v0) / count
        return np.asarray(v0 + pitch_m * (np.arange(count) + 0.5), dtype=np.float64), pitch_m
    first = math.ceil((v0 - anchor_m) / spacing_m - 0.5)
    last = math.floor((v1 - anchor_m) / spacing_m + 0.5)
    lines_m = anchor_m + spacing_m * np.arange(first, last + 1)
    return np.asarray(lines_m, dtype=np.float64), spacing_m


def _join_spans(shape: BaseGeometry) -> list[tuple[float, float]]:
    """Extents along u of the parts of a shape, overlapping ones joined."""
    import shapely

    if shape.is_empty:
        return []
    bounds = shapely.bounds(shapely.get_parts(shape))
    joined: list[tuple[float, float]] = []
    for start_m, end_m in sorted((float(b[0]), float(b[2])) for b in bounds):
        if joined and start_m <= joined[-1][1] + 1e-6:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end_m))
        else:
            joined.append((start_m, end_m))
    return joined


def _clip(
    wanted: Sequence[tuple[float, float]], free: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Parts of the wanted spans that are free, unless very short."""
    return [
        (max(a, c), min(b, d))
        for a, b in wanted for c, d in free
        if min(b, d) - max(a, c) > SHORTEST_M
    ]  # fmt: skip


def group_cells(swaths: Sequence[Swath]) -> list[list[Swath]]:
    """Group swaths with one neighbour on each side: they are driven up and down in one go.

    A swath that meets two on the next line, or two that meet one, end the cell: there a hole or
    a corner begins.
    """
    by_line: dict[int, list[Swath]] = {}
    for swath in swaths:
        by_line.setdefault(swath.line, []).append(swath)
    found: list[list[Swath]] = []
    open_cells: list[list[Swath]] = []
    for line in sorted(by_line):
        open_cells = [cell for cell in open_cells if cell[-1].line == line - 1]
        here = by_line[line]
        grown: list[list[Swath]] = []
        for swath in here:
            below = [cell for cell in open_cells if _do_meet(cell[-1], swath)]
            if len(below) == 1 and sum(_do_meet(below[0][-1], other) for other in here) == 1:
                below[0].append(swath)
                grown.append(below[0])
            else:
                grown.append([swath])
                found.append(grown[-1])
        open_cells = grown
    return found


def add_room(
    swaths: Sequence[Swath], drivable: BaseGeometry, yaw_rad: float, reach_m: float
) -> list[Swath]:
    """Add to the swaths what is open beyond their ends, up to `reach_m`."""
    import shapely

    if reach_m <= 0.0 or not swaths:
        return list(swaths)
    ends = np.array(
        [[[(s.start_m, s.v_m), (s.start_m - reach_m, s.v_m)],
          [(s.end_m, s.v_m), (s.end_m + reach_m, s.v_m)]] for s in swaths]
    )  # fmt: skip
    rays = rotate(ends.reshape(-1, 2), yaw_rad).reshape(-1, 2, 2)
    lines = np.asarray(shapely.linestrings(rays))
    closed = shapely.difference(lines, drivable)
    room_m = np.asarray(shapely.distance(closed, shapely.points(rays[:, 0])))
    room_m[np.isnan(room_m)] = reach_m  # nothing is closed
    return [
        swath._replace(before_m=float(before_m), after_m=float(after_m))
        for swath, (before_m, after_m) in zip(swaths, room_m.reshape(-1, 2), strict=True)
    ]


def find_drive(swath: Swath, tool_x_m: float) -> tuple[float, float]:
    """Find from where to where the robot drives a swath, upwards, so that the tool works it.

    It goes beyond the swath where the tool is behind, as far as there is room, and begins later.
    """
    start_m = swath.start_m - min(tool_x_m, swath.before_m)
    end_m = swath.end_m - max(tool_x_m, -swath.after_m)
    if end_m - start_m < SHORTEST_M:
        return swath.start_m, swath.end_m
    return start_m, end_m


def _do_meet(one: Swath, other: Swath) -> bool:
    return one.start_m <= other.end_m and other.start_m <= one.end_m
