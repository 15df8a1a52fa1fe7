"""Fields by chance as people and cadastres draw them, and what ground they mean."""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import FloatArray

HERE = Datum(lat_deg=52.1, lon_deg=11.6)
FRAME = MapFrame(HERE)
SPIKE_M = 6.0


class DrawnField(NamedTuple):
    """A GeoJSON text, and the ground in the map on which a robot may be."""

    text: str
    ground: BaseGeometry


def draw_field(rng: np.random.Generator) -> DrawnField:
    """Draw a star with spikes and obstacles inside and across its edge, maybe of two parts."""
    outline = draw_star(rng, float(rng.uniform(8.0, 22.0)))
    field = shapely.Polygon(outline)
    islands = [draw_island(rng, field) for _ in range(int(rng.integers(0, 6)))]
    ground = field.difference(shapely.union_all(islands)) if islands else field
    parts = [add_spikes(rng, outline)]
    if rng.random() < 0.3:  # a second parcel beside it, of a quarter of the area
        other = 0.5 * outline + (60.0, 0.0)
        parts.append(other)
        ground = ground.union(shapely.Polygon(other))
    features = [write("boundary", parts), *(write("obstacle", [ring(each)]) for each in islands)]
    return DrawnField(json.dumps({"type": "FeatureCollection", "features": features}), ground)


def draw_star(rng: np.random.Generator, radius_m: float) -> FloatArray:
    """Corners around the origin at uneven distances: mostly concave."""
    count = int(rng.integers(5, 14))
    angles = np.linspace(0.0, math.tau, count, endpoint=False) + rng.uniform(0.0, 0.3, count)
    reach_m = radius_m * rng.uniform(0.5, 1.0, count)
    corners: FloatArray = np.column_stack([reach_m * np.cos(angles), reach_m * np.sin(angles)])
    return corners


def draw_island(rng: np.random.Generator, field: shapely.Polygon) -> shapely.Polygon:
    """Draw a tree, a house or a pond, every other one on the edge of the field."""
    if rng.random() < 0.5:
        centre = field.exterior.interpolate(rng.random(), normalized=True)
    else:
        centre = shapely.Point(rng.uniform(*np.reshape(field.bounds, (2, 2))))
    shape = draw_star(rng, float(rng.uniform(0.3, 3.0))) + shapely.get_coordinates(centre)[0]
    island = shapely.Polygon(shape)
    return island if island.intersects(field) else draw_island(rng, field)


def add_spikes(rng: np.random.Generator, outline: FloatArray) -> FloatArray:
    """Add lines of no width to an outline: out of it or into it, and back."""
    corners = outline.tolist()
    for at in sorted(rng.choice(len(corners), int(rng.integers(0, 3)), replace=False))[::-1]:
        start, end = outline[at], outline[(at + 1) % len(outline)]
        middle, along = (start + end) / 2.0, (end - start) / math.dist(start, end)
        tip = middle + rng.choice([-1.0, 1.0]) * SPIKE_M * np.array([-along[1], along[0]])
        corners[at + 1 : at + 1] = [middle.tolist(), tip.tolist(), middle.tolist()]
    return np.array(corners)


def ring(polygon: shapely.Polygon) -> FloatArray:
    return np.asarray(shapely.get_coordinates(polygon.exterior)[:-1])


def write(kind: str, rings: list[FloatArray]) -> dict[str, Any]:
    written = [[[place(x_m, y_m) for x_m, y_m in [*each, each[0]]]] for each in rings]
    geometry = {"type": "Polygon", "coordinates": written[0]}
    if len(written) > 1:
        geometry = {"type": "MultiPolygon", "coordinates": written}
    return {"type": "Feature", "properties": {"kind": kind}, "geometry": geometry}


def place(x_m: float, y_m: float) -> list[float]:
    lat_deg, lon_deg, _ = FRAME.geodetic_from_map(float(x_m), float(y_m))
    return [lon_deg, lat_deg]
