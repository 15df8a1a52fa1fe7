"""The patch of ground that one frame covered."""

from __future__ import annotations

import math

from agribot.autonomy.weeds.poses import PoseAt

Point = tuple[float, float]


class GroundView:
    """A convex polygon of the body frame, asked about places of the map."""

    def __init__(self, polygon_body_m: tuple[Point, ...], pose: PoseAt) -> None:
        self._map_from_body = pose.map_from_body
        self._edges = _inward_edges(polygon_body_m)
        corners = (
            [self._map_from_body.transform(x, y) for x, y in polygon_body_m] if self._edges else []
        )
        self.is_empty = not corners
        xs = [x for x, _ in corners] or [0.0]
        ys = [y for _, y in corners] or [0.0]
        self.bounds_map_m = (min(xs), min(ys), max(xs), max(ys))

    def covers(self, x_map_m: float, y_map_m: float, inset_m: float) -> bool:
        """Whether a place lies inside, at least `inset_m` from every edge."""
        x_body_m, y_body_m = self._map_from_body.locate(x_map_m, y_map_m)
        return all(nx * x_body_m + ny * y_body_m - c >= inset_m for nx, ny, c in self._edges)


def _inward_edges(polygon_m: tuple[Point, ...]) -> list[tuple[float, float, float]]:
    """Compute unit normals into the polygon and their offsets; none for one without area."""
    following = polygon_m[1:] + polygon_m[:1]
    pairs = list(zip(polygon_m, following, strict=True))
    area2_m2 = sum(ax * by - bx * ay for (ax, ay), (bx, by) in pairs)
    if area2_m2 == 0.0:
        return []
    turn = math.copysign(1.0, area2_m2)
    edges = []
    for (ax, ay), (bx, by) in pairs:
        length_m = math.hypot(bx - ax, by - ay)
        if length_m > 0.0:
            nx, ny = -turn * (by - ay) / length_m, turn * (bx - ax) / length_m
            edges.append((nx, ny, nx * ax + ny * ay))
    return edges
