"""Shortest ways without touching: a visibility graph over the corners of the free space."""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.autonomy.plan.coverage.free_space import ROUNDING_M
from agribot.core.errors import MissionError
from agribot.core.facts import NoWayInside
from agribot.core.messages import FloatArray, MapPoint

if TYPE_CHECKING:
    import shapely
    from shapely.geometry.base import BaseGeometry

IndexArray = npt.NDArray[np.int64]

# Largest number of corners. Simplified ones are hidden from a place in a notch of the outline, so
# that no way is found.
MAX_CORNERS = 10_000
MAX_PAIRS = 500_000  # pairs of corners computed at once: 60 MB
FIRST_SIMPLIFY_M = 0.05
# A way that is no longer than this against the distance, and this, is searched for first, m.
DETOUR_RATIO, DETOUR_M = 1.2, 4.0
ALONG_M = 1e-3  # a place that is off the line of an edge by less lies on it


class Ways:
    """`drivable` must be prepared and slightly larger than the `region` whose corners are used."""

    def __init__(self, region: shapely.Polygon, drivable: BaseGeometry) -> None:
        self._drivable = drivable
        self._region = region
        self._corners: _Corners | None = None
        self._graph: list[list[tuple[float, int]]] = []

    def is_open(self, start: MapPoint, end: MapPoint) -> bool:
        import shapely

        return bool(self._drivable.covers(shapely.LineString((start, end))))

    def way(self, start: MapPoint, end: MapPoint) -> list[MapPoint]:
        """Find the corner points of the shortest way, both ends included.

        Raises: MissionError: there is no way.
        """
        inner_start, inner_end = self._inside(start), self._inside(end)
        if math.dist(start, end) < 1e-9 or self.is_open(inner_start, inner_end):
            return [start, end]
        found = self._find_way(inner_start, inner_end)
        if found is None:
            raise MissionError(NoWayInside(*start, *end))
        return [start, *found, end]

    def _inside(self, place: MapPoint) -> MapPoint:
        """Find the place, or the edge beside it: a rounded bend ends some millimetres outside."""
        import shapely

        here = shapely.Point(place)
        if self._drivable.covers(here) or self._region.distance(here) > ROUNDING_M:
            return place
        x_m, y_m = shapely.get_coordinates(shapely.shortest_line(here, self._region))[1]
        return float(x_m), float(y_m)

    def _build(self) -> _Corners:
        """Find every pair of corners that see each other and that a shortest way may join."""
        corners = _find_inner_corners(self._region)
        first, second = corners.pair_up()
        seen = self._find_covered(corners.places[first], corners.places[second])
        first, second = first[seen], second[seen]
        lengths = np.hypot(*(corners.places[first] - corners.places[second]).T)
        self._graph = [[] for _ in corners.places]
        for a, b, length_m in zip(first.tolist(), second.tolist(), lengths.tolist(), strict=True):
            self._graph[a].append((length_m, b))
            self._graph[b].append((length_m, a))
        return corners

    def _find_way(self, start: MapPoint, end: MapPoint) -> list[MapPoint] | None:
        """Find the bends of the shortest way, first among those that a short one can touch."""
        corners = self._corners
        if corners is None:
            corners = self._corners = self._build()
        for most_m in (DETOUR_RATIO * math.dist(start, end) + DETOUR_M, math.inf):
            found = self._search(corners, start, end, most_m)
            if found is not None:
                return [(float(x), float(y)) for x, y in corners.places[found]]
        return None

    def _see(
        self, corners: _Corners, point: MapPoint, near: IndexArray, away_m: FloatArray
    ) -> dict[int, float]:
        """Find which of some corners a shortest way from a point may bend around first."""
        starts = np.broadcast_to(np.array(point), (len(near), 2))
        if corners.is_exact:  # a place may lie outside a simplified outline
            touches = corners.is_tangent(near, starts)
            near, starts = near[touches], starts[touches]
        near = near[self._find_covered(starts, corners.places[near])]
        return dict(zip(near.tolist(), away_m[near].tolist(), strict=True))

    def _find_covered(self, starts: FloatArray, ends: FloatArray) -> FloatArray:
        import shapely

        if not len(starts):
            return np.zeros(0, dtype=bool)
        lines = shapely.linestrings(np.stack([starts, ends], axis=1))
        return np.asarray(shapely.covers(self._drivable, lines))

    def _search(
        self, corners: _Corners, start: MapPoint, end: MapPoint, most_m: float
    ) -> list[int] | None:
        """Search a way of at most that length over the corners; the last step is to the end."""
        from_m, to_m = (np.hypot(*(corners.places - p).T) for p in (start, end))
        near = np.flatnonzero(from_m + to_m <= most_m)
        best = self._see(corners, start, near, from_m)
        to_end = self._see(corners, end, near, to_m)
        before: dict[int, int] = {}
        queue = [(length_m, corner) for corner, length_m in best.items()]
        heapq.heapify(queue)
        goal_m, last = most_m, -1
        while queue:
            done_m, corner = heapq.heappop(queue)
            if done_m > best[corner] or done_m >= goal_m:
                continue
            if corner in to_end and done_m + to_end[corner] < goal_m:
                goal_m, last = done_m + to_end[corner], corner
            for step_m, other in self._graph[corner]:
                if done_m + step_m < best.get(other, goal_m):
                    best[other], before[other] = done_m + step_m, corner
                    heapq.heappush(queue, (done_m + step_m, other))
        if last < 0:
            return None
        trail = [last]
        while trail[-1] in before:
            trail.append(before[trail[-1]])
        return trail[::-1]


class _Corners(NamedTuple):
    """Places (N, 2) at which an outline points into the area, and how it leaves them.

    `before` and `after` are unit vectors along the outline, away from the place.
    """

    places: FloatArray
    before: FloatArray
    after: FloatArray
    is_exact: bool = True

    def is_tangent(self, at: IndexArray, starts: FloatArray) -> npt.NDArray[np.bool_]:
        """Say for corners (M,) whether the line from a start (M, 2) has the outline on one side.

        A shortest way comes to its bends so.
        """
        ahead = self.places[at] - starts
        one, other = _cross(ahead, self.before[at]), _cross(ahead, self.after[at])
        is_left = (one >= -ALONG_M) & (other >= -ALONG_M)
        return np.asarray(is_left | ((one <= ALONG_M) & (other <= ALONG_M)))

    def pair_up(self) -> tuple[IndexArray, IndexArray]:
        """Find the pairs of corners whose line has the outline on one side at both."""
        count = len(self.places)
        at_once = max(1, MAX_PAIRS // max(count, 1))
        found = [np.zeros((2, 0), np.int64)]
        for begin in range(0, count, at_once):
            first, second = np.triu_indices(min(at_once, count - begin), 1, count - begin)
            first, second = first + begin, second + begin
            starts, ends = self.places[first], self.places[second]
            touches = self.is_tangent(second, starts) & self.is_tangent(first, ends)
            found.append(np.stack([first[touches], second[touches]]))
        pairs = np.concatenate(found, axis=1)
        return pairs[0], pairs[1]


def _aim(starts: FloatArray, ends: FloatArray) -> FloatArray:
    step = ends - starts
    return np.asarray(step / np.maximum(np.hypot(*step.T), 1e-12)[:, None])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _find_inner_corners(region: shapely.Polygon) -> _Corners:
    """Corners that a shortest way can bend around: those that point into the area.

    A boundary with very many corners is simplified inwards until they are few enough.
    """
    tolerance_m = FIRST_SIMPLIFY_M
    corners = _find_reflex(region)
    while len(corners.places) > MAX_CORNERS:
        smaller = region.buffer(-tolerance_m, join_style="mitre").simplify(tolerance_m)
        corners = _find_reflex(smaller)._replace(is_exact=False)
        tolerance_m *= 2.0
    return corners


def _find_reflex(region: BaseGeometry) -> _Corners:
    import shapely

    found = [np.zeros((0, 3, 2))]
    for part in shapely.get_parts(region):
        normal = shapely.orient_polygons(part)
        for ring in (normal.exterior, *normal.interiors):
            xy = shapely.get_coordinates(ring)[:-1]
            before, after = (_aim(xy, np.roll(xy, step, axis=0)) for step in (1, -1))
            is_reflex = _cross(after, before) < 0.0
            found.append(np.stack([xy, before, after], axis=1)[is_reflex])
    table = np.concatenate(found)
    return _Corners(table[:, 0], table[:, 1], table[:, 2])
