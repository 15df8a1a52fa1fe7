"""The ground of a field: its boundary without obstacles, as drawings have them.

Spikes of no width and rings that touch themselves are cleaned; obstacles may touch the edge or
lie across it. A ring that crosses itself is refused, since its inside is ambiguous.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import msgspec

from agribot.core.errors import MissionError
from agribot.core.facts import (
    AbLineClosed,
    AnyFact,
    LineShort,
    ObstacleOutside,
    ObstaclesEverywhere,
    RingCrosses,
    RingFlat,
    RingShort,
    RowOutside,
)
from agribot.core.geo import MapFrame
from agribot.core.messages import MapPoint

if TYPE_CHECKING:
    import shapely
    from shapely.geometry.base import BaseGeometry

Ring = Sequence[MapPoint]

# Ground that cleaning a ring may add or take, and that is lost without a word, m2.
CLEANED_M2, SPECK_M2 = 0.01, 0.01
TOUCH_M = 0.01  # distance from the edge within which an obstacle is at the edge


class GroundFault(MissionError):
    """Fault of a field and its place: `bare` is the fact without the place."""

    bare: AnyFact
    at_map_m: MapPoint = (0.0, 0.0)


Located = AbLineClosed | LineShort | ObstacleOutside | RingCrosses | RowOutside


def make_fault(bare: Located, point: Sequence[float], frame: MapFrame) -> GroundFault:
    """Make an error of what is wrong, at a point of the map."""
    fault = GroundFault(msgspec.structs.replace(bare, at=locate(point, frame)))
    fault.bare, fault.at_map_m = bare, (float(point[0]), float(point[1]))
    return fault


def clean_ground(
    boundary: Ring, obstacles: Sequence[Ring], source_name: str, frame: MapFrame
) -> tuple[shapely.Polygon, str]:
    """Cut obstacles out of a boundary (m, map); what is cut off by them is named in one line.

    Raises: MissionError: a ring crosses itself, an obstacle lies outside, or nothing is left.
    """
    import shapely

    outer = _clean_ring(boundary, f"{source_name}: the boundary", frame)
    areas = []
    for number, ring in enumerate(obstacles, 1):
        name = f"{source_name}: obstacle {number}"
        areas.append(_clean_ring(ring, name, frame))
        _check_inside(areas[-1], outer, name, frame)
    joined = [shapely.Polygon(area.exterior) for area in list_areas(shapely.union_all(areas))]
    within = outer.buffer(-TOUCH_M)
    inside = [area for area in joined if within.covers(area)]
    across = [area for area in joined if not within.covers(area)]
    taken = shapely.union_all(across)
    # A sliver between an obstacle and the edge is no ground.
    slivers = taken.buffer(TOUCH_M, join_style="mitre").difference(within)
    ground = outer.difference(taken.union(slivers)) if across else outer
    parts = sorted(list_areas(ground), key=lambda part: -part.area)
    if not parts:
        raise MissionError(ObstaclesEverywhere(source_name))
    holes = [area.exterior for area in inside if parts[0].contains(area)]
    left_out = _name_parts(parts[1:], source_name, frame)
    return shapely.Polygon(parts[0].exterior, [*parts[0].interiors, *holes]), left_out


def _name_parts(parts: Sequence[shapely.Polygon], source_name: str, frame: MapFrame) -> str:
    if not parts:
        return ""
    at = locate(parts[0].representative_point().coords[0], frame)
    count = f"{len(parts)} parts" if len(parts) > 1 else "a part"
    return (
        f"{source_name}: {count} of {sum(part.area for part in parts):.1f} m2, the largest at "
        f"{at}, cut off from the rest of the field and left out"
    )


def list_areas(shape: BaseGeometry) -> list[shapely.Polygon]:
    """List the polygons in a geometry, without lines, points and specks."""
    import shapely

    parts = shapely.get_parts(shapely.get_parts(shape)).tolist()
    return [part for part in parts if part.geom_type == "Polygon" and part.area > SPECK_M2]


def _check_inside(area: BaseGeometry, outer: BaseGeometry, name: str, frame: MapFrame) -> None:
    """Refuse an obstacle that does not even touch the field: its file is another field's."""
    if area.distance(outer) > TOUCH_M:
        place = area.representative_point().coords[0]
        raise make_fault(ObstacleOutside(name), place, frame)


def _clean_ring(ring: Ring, name: str, frame: MapFrame) -> BaseGeometry:
    """Make areas of a ring; zero width is dropped, one that crosses itself refused."""
    import shapely

    if len(ring) < 3:
        raise MissionError(RingShort(name, len(ring)))
    polygon = shapely.Polygon(ring)
    if polygon.area == 0.0:
        raise MissionError(RingFlat(name))
    cleaned = clean_area(polygon)
    if cleaned is None:
        spot = re.search(r"\[(\S+) (\S+)\]", shapely.is_valid_reason(polygon))
        point = (float(spot[1]), float(spot[2])) if spot else ring[0]
        raise make_fault(RingCrosses(name), point, frame)
    return cleaned


def clean_area(polygon: shapely.Polygon) -> BaseGeometry | None:
    """Drop what has no width; None where an area crosses itself.

    There its loops count once forwards and once backwards in the area of its corners.
    """
    import shapely

    if polygon.is_valid:
        return polygon
    cleaned = shapely.union_all(list_areas(shapely.make_valid(polygon)))
    return cleaned if abs(cleaned.area - polygon.area) <= CLEANED_M2 else None


def locate(point: Sequence[float], frame: MapFrame) -> str:
    """Say where a point of the map lies, in degrees."""
    lat_deg, lon_deg, _ = frame.geodetic_from_map(float(point[0]), float(point[1]))
    return f"latitude {lat_deg:.7f}, longitude {lon_deg:.7f}"
