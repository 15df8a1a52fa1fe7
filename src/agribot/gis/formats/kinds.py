"""What the shapes of a file are that do not say it: outlines, fields, obstacles, rows and goals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from agribot.gis.formats.outlines import close_line
from agribot.gis.formats.partfield_ground import PartfieldGround

# Keys of OpenStreetMap on lines and points of what stands or flows there.
_STANDING = {"barrier", "highway", "man_made", "natural", "power", "railway", "waterway"}
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


def give_kinds(found: Members, left_out: Counter[str]) -> Counter[str]:
    """Give each feature without a kind one; count the lines and points whose use was guessed.

    Areas are boundaries, and obstacles where they lie in another one or a boundary is named. So are
    lines and points that a tag of OpenStreetMap has something stand on. Other lines are rows.
    """
    untold = [feature for feature in found if not feature["properties"].get("kind")]
    is_bounded = any(feature["properties"].get("kind") == "boundary" for feature in found)
    areas = [feature for feature in untold if feature["geometry"]["type"] == "Polygon"]
    inner = range(len(areas)) if is_bounded else find_inner([f["geometry"] for f in areas])
    for number, feature in enumerate(areas):
        feature["properties"]["kind"] = "obstacle" if number in inner else "boundary"
    others = [feature for feature in untold if feature["geometry"]["type"] != "Polygon"]
    _draw_standing([f for f in others if any(map(f["properties"].get, _STANDING))], found, left_out)
    guessed = [feature for feature in others if not feature["properties"].get("kind")]
    for feature in guessed:
        feature["properties"]["kind"] = _KIND_OF[feature["geometry"]["type"]]
    return Counter(feature["geometry"]["type"] for feature in guessed)


def _draw_standing(standing: Members, found: Members, left_out: Counter[str]) -> None:
    """Replace what stands in a field by its ground."""
    outlines = [
        feature["geometry"]["coordinates"][0]
        for feature in found
        if feature["properties"].get("kind") == "boundary"
    ]
    ground = PartfieldGround(outlines)
    for feature in standing if outlines else ():
        shape, properties = feature["geometry"], feature["properties"]
        places = shape["coordinates"] if shape["type"] == "LineString" else [shape["coordinates"]]
        found[:] = [each for each in found if each is not feature]
        properties["kind"] = "obstacle"
        for geometry, drawn in ground.draw_obstacle(places):
            if geometry is None:
                left_out[drawn["left_out"]] += 1
            else:
                found.append(
                    {"type": "Feature", "geometry": geometry, "properties": {**properties}}
                )


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
