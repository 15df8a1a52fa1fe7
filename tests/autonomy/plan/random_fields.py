"""Fields by chance: concave, narrow, and full of holes."""

from __future__ import annotations

import math

import numpy as np

from agribot.autonomy.plan.coverage.area import FieldArea, MapLine
from agribot.core.messages import FloatArray

MAX_HOLES = 25
WIDTHS_M = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)


def random_field(rng: np.random.Generator) -> tuple[FieldArea, float]:
    """A field and an implement width. Every third is narrow, every third full of holes."""
    import shapely

    kind = int(rng.integers(3))
    outline = _star(rng, float(rng.uniform(10.0, 60.0)))
    if kind == 1:  # long and narrow, with a waist
        outline = outline * np.array([1.0, float(rng.uniform(0.08, 0.35))])
    yaw = float(rng.uniform(0.0, math.tau))
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    field = shapely.make_valid(shapely.Polygon(outline @ turn + rng.uniform(-50.0, 50.0, 2)))
    field = max(
        (p for p in shapely.get_parts(field) if p.geom_type == "Polygon"), key=lambda p: p.area
    )
    holes: list[shapely.Polygon] = []
    wanted = int(rng.integers(5, MAX_HOLES)) if kind == 2 else int(rng.integers(0, 3))
    x0, y0, x1, y1 = field.bounds
    for _ in range(wanted):
        centre = rng.uniform((x0, y0), (x1, y1))
        hole = shapely.Polygon(_star(rng, float(rng.uniform(0.2, 4.0))) + centre).buffer(0)
        apart = all(hole.distance(other) > 0.01 for other in holes)
        if apart and hole.geom_type == "Polygon" and field.contains_properly(hole):
            holes.append(hole)
    area = FieldArea(boundary=_line(field), holes=tuple(_line(hole) for hole in holes))
    return area, float(rng.choice(WIDTHS_M))


def _star(rng: np.random.Generator, radius_m: float) -> FloatArray:
    """Corners around the origin at uneven distances: mostly concave."""
    count = int(rng.integers(3, 14))
    angles = np.sort(rng.uniform(0.0, math.tau, count)) + np.linspace(0.0, 1e-3, count)
    reach_m = radius_m * rng.uniform(0.3, 1.0, count)
    return np.column_stack([reach_m * np.cos(angles), reach_m * np.sin(angles)])


def _line(polygon: object) -> MapLine:
    import shapely

    xy = shapely.get_coordinates(polygon.exterior)[:-1]  # type: ignore[attr-defined]
    return tuple((float(x), float(y)) for x, y in xy)
