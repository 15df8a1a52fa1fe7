"""Shortest ways without touching: a visibility graph over the corners of the free space."""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING

import numpy as np

from agribot.autonomy.plan.coverage.free_space import ROUNDING_M
from agribot.core.errors import MissionError
from agribot.core.messages import FloatArray, MapPoint

if TYPE_CHECKING:
    import shapely
    from shapely.geometry.base import BaseGeometry

MAX_CORNERS = 800
FIRST_SIMPLIFY_M = 0.05


class Ways:
    """`drivable` must be prepared and slightly larger than the `region` whose corners are used."""

    def __init__(self, region: shapely.Polygon, drivable: BaseGeometry) -> None:
        self._drivable = drivable
        self._region = region
        self._corners: FloatArray | None = None
        self._graph: list[list[tuple[float, int]]] = []

    def is_open(self, start: MapPoint, end: MapPoint) -> bool:
        import shapely

        return bool(self._drivable.covers(shapely.LineString((start, end))))

    def way(self, start: MapPoint, end: MapPoint) -> list[MapPoint]:
        """Find the corner points of the shortest way, both ends included.

        Raises: MissionError: there is none.
        """
        inner_start, inner_end = self._inside(start), self._inside(end)
        if math.dist(start, end) < 1e-9 or self.is_open(inner_start, inner_end):
            return [start, end]
        if self._corners is None:
            self._build()
        assert self._corners is not None
        from_start, from_end = self._seen_from(inner_start), self._seen_from(inner_end)
        found = self._search(from_start, from_end)
        if found is None:
            raise MissionError(
                f"no way from East {start[0]:.2f} m, North {start[1]:.2f} m to East "
                f"{end[0]:.2f} m, North {end[1]:.2f} m keeps the robot inside the field"
            )
        return [start, *((float(x), float(y)) for x, y in self._corners[found]), end]

    def _inside(self, place: MapPoint) -> MapPoint:
        """Find the place, or the edge beside it: a rounded bend ends some millimetres outside."""
        import shapely

        here = shapely.Point(place)
        if self._drivable.covers(here) or self._region.distance(here) > ROUNDING_M:
            return place
        x_m, y_m = shapely.get_coordinates(shapely.shortest_line(here, self._region))[1]
        return float(x_m), float(y_m)

    def _build(self) -> None:
        """Every pair of corners that see each other."""
        corners = _find_inner_corners(self._region)
        self._corners = corners
        first, second = np.triu_indices(len(corners), 1)
        seen = self._find_covered(corners[first], corners[second])
        first, second = first[seen], second[seen]
        lengths = np.hypot(*(corners[first] - corners[second]).T)
        self._graph = [[] for _ in corners]
        for a, b, length_m in zip(first.tolist(), second.tolist(), lengths.tolist(), strict=True):
            self._graph[a].append((length_m, b))
            self._graph[b].append((length_m, a))

    def _seen_from(self, point: MapPoint) -> dict[int, float]:
        assert self._corners is not None
        if not len(self._corners):
            return {}
        starts = np.broadcast_to(np.array(point), self._corners.shape)
        seen = self._find_covered(starts, self._corners)
        lengths = np.hypot(*(self._corners - starts).T)
        return {int(k): float(lengths[k]) for k in np.flatnonzero(seen)}

    def _find_covered(self, starts: FloatArray, ends: FloatArray) -> FloatArray:
        import shapely

        if not len(starts):
            return np.zeros(0, dtype=bool)
        lines = shapely.linestrings(np.stack([starts, ends], axis=1))
        return np.asarray(shapely.covers(self._drivable, lines))

    def _search(self, from_start: dict[int, float], to_end: dict[int, float]) -> list[int] | None:
        """Dijkstra over the corners; the last step is the one to the end."""
        best = dict(from_start)
        before: dict[int, int] = {}
        queue = [(length_m, corner) for corner, length_m in from_start.items()]
        heapq.heapify(queue)
        goal_m, last = math.inf, -1
        while queue:
            done_m, corner = heapq.heappop(queue)
            if done_m > best[corner] or done_m >= goal_m:
                continue
            if corner in to_end and done_m + to_end[corner] < goal_m:
                goal_m, last = done_m + to_end[corner], corner
            for step_m, other in self._graph[corner]:
                if done_m + step_m < best.get(other, math.inf):
                    best[other], before[other] = done_m + step_m, corner
                    heapq.heappush(queue, (done_m + step_m, other))
        if last < 0:
            return None
        trail = [last]
        while trail[-1] in before:
            trail.append(before[trail[-1]])
        return trail[::-1]


def _find_inner_corners(region: shapely.Polygon) -> FloatArray:
    """Corners that a shortest way can bend around: those that point into the area.

    A boundary with very many corners is simplified inwards until they are few enough.
    """
    tolerance_m = FIRST_SIMPLIFY_M
    corners = _find_reflex(region)
    while len(corners) > MAX_CORNERS:
        smaller = region.buffer(-tolerance_m, join_style="mitre").simplify(tolerance_m)
        corners = _find_reflex(smaller)
        tolerance_m *= 2.0
    return corners


def _find_reflex(region: BaseGeometry) -> FloatArray:
    import shapely

    found = []
    for part in shapely.get_parts(region):
        normal = shapely.orient_polygons(part)
        for ring in (normal.exterior, *normal.interiors):
            xy = shapely.get_coordinates(ring)[:-1]
            before, after = xy - np.roll(xy, 1, axis=0), np.roll(xy, -1, axis=0) - xy
            cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            found.append(xy[cross < 0.0])
    return np.concatenate(found) if found else np.zeros((0, 2))
