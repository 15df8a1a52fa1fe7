"""What the shapes of a file are that do not say it: outlines, fields, obstacles, rows and goals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from agribot.gis.formats.outlines import close_line

_KIND_OF = {"LineString": "row", "Point": "waypoint"}
_AREAS = {"boundary", "obstacle"}
Members = list[dict[str, Any]]


def close_lines(found: Members, changes: Counter[str]) -> None:
    """Make areas of lines that go around one, or are said to be one; count what was changed."""
    for feature in found:
        kind, shape = feature["properties"].get("kind"), feature["geometry"]
        if shape["type"] != "LineString" or kind not in {None, "", *_AREAS}:
            continue
        points = [(lon, lat) for lon, lat in shape["coordinates"]]
        outline = close_line(points, is_area=kind in _AREAS)
        if outline is None:
            continue
        feature["geometry"] = {"type": "Polygon", "coordinates": [outline.ring]}
        if outline.change:
            name = str(feature["properties"].get("name") or "without a name")[:40]
            changes[f"line '{name}' is taken for an area: {outline.change}"] += 1


def give_kinds(found: Members) -> int:
    """Give each feature without a kind one; return how many points became goals.

    Areas are boundaries, and obstacles where they lie in another one or a boundary is named. Lines
    are rows.
    """
    unnamed = [feature for feature in found if not feature["properties"].get("kind")]
    is_bounded = any(feature["properties"].get("kind") == "boundary" for feature in found)
    areas = [feature for feature in unnamed if feature["geometry"]["type"] == "Polygon"]
    inner = range(len(areas)) if is_bounded else find_inner([f["geometry"] for f in areas])
    for number, feature in enumerate(areas):
        feature["properties"]["kind"] = "obstacle" if number in inner else "boundary"
    others = [feature for feature in unnamed if feature["geometry"]["type"] != "Polygon"]
    for feature in others:
        feature["properties"]["kind"] = _KIND_OF[feature["geometry"]["type"]]
    return sum(feature["geometry"]["type"] == "Point" for feature in others)


def find_inner(areas: Sequence[dict[str, Any]]) -> set[int]:
    """Find the areas that lie inside another one: a place in them does, and they are smaller.

    What encloses nothing is no field beside others.
    """
    import numpy as np
    import shapely

    if len(areas) < 2:
        return set()
    shapes = np.array([make_outline(area) for area in areas])
    size = shapely.area(shapes)
    inside, around = shapely.STRtree(shapes).query(
        shapely.point_on_surface(shapes), predicate="within"
    )
    is_inner = (size[around] > size[inside]) | ((size[around] == size[inside]) & (around < inside))
    flat = np.flatnonzero((size == 0.0) & size.any())
    return {*inside[is_inner].tolist(), *flat.tolist()}


def make_outline(area: dict[str, Any]) -> Any:
    """Make the outer ring of a polygon an area without holes, in degrees; crossings are cut off."""
    import shapely

    ring = area["coordinates"][0]
    return shapely.make_valid(shapely.Polygon(ring)) if len(ring) > 3 else shapely.Polygon()
