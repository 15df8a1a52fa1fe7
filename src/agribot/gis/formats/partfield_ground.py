"""Obstacles of a partfield: points, lines, and areas of an unknown type."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from agribot.core.geo import Datum, MapFrame
from agribot.gis.geojson import Found, Geometry, LonLat, describe_left_out

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

OBSTACLE_RADIUS_M = 0.5  # around points and beside lines, which have no size or a smaller one
EDGE_M = 0.02  # left between an obstacle that reaches the edge and the edge
LEAST_M2 = 1e-3  # area of an obstacle


class PartfieldGround:
    """The inside of a partfield, to which such obstacles are cut: fences stand on its edge."""

    def __init__(self, outlines: Sequence[Sequence[LonLat]]) -> None:
        self._outlines = [outline for outline in outlines if len(outline) > 2]

    def draw_obstacle(
        self, positions: Sequence[LonLat], radius_m: float = 0.0, *, is_area: bool = False
    ) -> Found:
        """Draw an obstacle around a point or a line, or of an area; say so where none is left."""
        import shapely

        outline = self._outlines[0] if self._outlines else positions
        frame = frame_at(outline[0])
        shape = _make_shape(_to_map(positions, frame), is_area=is_area)
        if not is_area:
            shape = shape.buffer(max(radius_m, OBSTACLE_RADIUS_M), quad_segs=4)
        if self._outlines:
            fields = [shapely.Polygon(_to_map(each, frame)).buffer(0) for each in self._outlines]
            shape = shape.intersection(shapely.union_all(fields).buffer(-EDGE_M))
        parts = [part for part in shapely.get_parts(shape).tolist() if part.area > LEAST_M2]
        for part in parts:
            places = [frame.geodetic_from_map(x_m, y_m) for x_m, y_m in part.exterior.coords]
            yield make_area("obstacle", [(lon_deg, lat_deg) for lat_deg, lon_deg, _ in places])
        if not parts:
            yield describe_left_out("obstacle beyond the boundary")


def make_area(kind: str, *rings: list[LonLat]) -> tuple[Geometry, dict[str, Any]]:
    """Make a feature of an outline and its holes."""
    return {"type": "Polygon", "coordinates": list(rings)}, {"kind": kind}


def frame_at(position: LonLat) -> MapFrame:
    """Make a map with its origin at a place."""
    return MapFrame(Datum(lat_deg=position[1], lon_deg=position[0]))


def _to_map(positions: Iterable[LonLat], frame: MapFrame) -> list[tuple[float, float]]:
    return [frame.map_from_geodetic(lat, lon, 0.0)[:2] for lon, lat in positions]


def _make_shape(places: list[tuple[float, float]], *, is_area: bool) -> BaseGeometry:
    """Make an area, a line or a point; an area of too few corners is the line along them."""
    import shapely

    if is_area and len(places) > 3:
        return shapely.Polygon(places).buffer(0)
    return shapely.LineString(places) if len(places) > 1 else shapely.Point(places[0])
