"""Boundaries of several parts, of which a plan needs one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from agribot.core.geo import Datum, MapFrame

Geometry = dict[str, Any]
Feature = dict[str, Any]


def find_boundary(features: Sequence[Feature]) -> Feature | None:
    """Find the feature that says that it is the boundary, else the first area without a kind."""
    areas = [f for f in features if str((f["geometry"] or {}).get("type")).endswith("Polygon")]
    kinds = [area["properties"].get("kind") for area in areas]
    for wanted in ("boundary", None):
        if wanted in kinds:
            return areas[kinds.index(wanted)]
    return None


def keep_largest(parts: list[Geometry]) -> tuple[list[Geometry], list[str]]:
    """Keep the largest of several polygons, and name the others."""
    areas_m2 = [_measure_m2(part) for part in parts]
    largest = int(np.argmax(areas_m2))
    smaller = [
        f"a part of the boundary of {area_m2:.0f} m2; plan it from a file of its own"
        for number, area_m2 in enumerate(areas_m2)
        if number != largest
    ]
    return parts[largest : largest + 1], smaller


def _measure_m2(polygon: Geometry) -> float:
    """Measure the area within an outer ring."""
    ring = np.array([position[:2] for position in polygon["coordinates"][0]], dtype=np.float64)
    frame = MapFrame(Datum(lat_deg=float(ring[0, 1]), lon_deg=float(ring[0, 0])))
    x, y = np.array([frame.map_from_geodetic(lat, lon, 0.0)[:2] for lon, lat in ring]).T
    return abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))) / 2.0
