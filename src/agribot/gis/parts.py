"""Split boundaries of several parts: a plan needs one, as no way leads from part to part."""

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


def split_boundary(parts: list[Geometry], properties: dict[str, Any]) -> list[Feature]:
    """Make a boundary of each of several polygons, the largest first, the others named by number.

    Their areas stand beside, in `area_m2`.
    """
    sizes_m2 = [_measure_m2(part) for part in parts]
    largest_first = sorted(range(len(parts)), key=lambda number: -sizes_m2[number])
    name = str(properties.get("name") or "").strip()
    return [
        {
            "type": "Feature",
            "geometry": parts[number],
            "properties": {**properties}
            if place == 1
            else {
                **properties,
                "kind": "boundary",
                "name": f"{name} part {place}".strip(),
                "area_m2": sizes_m2[number],
            },
        }
        for place, number in enumerate(largest_first, 1)
    ]


def describe_part(part: Feature) -> str:
    """Name a part that is not the field, and how it becomes one."""
    name, area_m2 = part["properties"]["name"], part["properties"]["area_m2"]
    return (
        f"a part of the boundary of {area_m2:.0f} m2; choose it behind the name of the file: "
        f"'#{name}'"
    )


def _measure_m2(polygon: Geometry) -> float:
    """Measure the area within an outer ring."""
    ring = np.array([position[:2] for position in polygon["coordinates"][0]], dtype=np.float64)
    frame = MapFrame(Datum(lat_deg=float(ring[0, 1]), lon_deg=float(ring[0, 0])))
    x, y = np.array([frame.map_from_geodetic(lat, lon, 0.0)[:2] for lon, lat in ring]).T
    return abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))) / 2.0
