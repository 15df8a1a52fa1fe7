"""Where the robot's centre may be: places at which it can turn in place without touching."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from agribot.autonomy.plan.coverage.area import FieldArea, PlanRequest
from agribot.autonomy.plan.ways.footprint import Footprint
from agribot.core.errors import MissionError
from agribot.core.facts import NoHeadland, NoPlaceToTurn, StartOutside
from agribot.core.messages import FloatArray, MapPoint

if TYPE_CHECKING:
    import shapely
    from shapely.geometry.base import BaseGeometry


class _Outline(NamedTuple):
    """Chords in a quarter of a circle, and how far points may be left out, m."""

    quarter_segments: int
    simplify_m: float


# The outline is drawn with few points; where that eats at the margin, it is drawn in farther.
# Of obstacles there may be many, and around them less ground is lost.
BOUNDARY, OBSTACLES = _Outline(32, 0.001), _Outline(8, 0.003)
MAX_REDRAWN = 4
ROUNDING_M = 0.01  # rounded bends cut this much off their corners
MITRE_LIMIT = 2.0
# Tolerance for paths that touch the edge of the free space; covers rounding.
TOUCH_M = 1e-4
# Kept beyond the margin, m: such touches, and as much for the digits of a plan file.
SPARE_M = 2e-4


class FreeSpace:
    """The connected part of the field that is planned, for a robot seen as its turning circle."""

    def __init__(
        self,
        area: FieldArea,
        shape: Footprint,
        request: PlanRequest,
        keep_out: BaseGeometry | None = None,
        spare_m: float = 0.0,
    ) -> None:
        """Find the room to turn, and to go beyond the outline by `spare_m`.

        Raises: MissionError: the field has no such room.
        """
        import shapely

        self.edge = shapely.Polygon(area.boundary, area.holes).boundary
        shapely.prepare(self.edge)
        self.away_m = shape.turn_radius_m + request.margin_m + SPARE_M
        depth_m = self.away_m + spare_m
        free = _keep_off(shapely.Polygon(area.boundary), -depth_m, BOUNDARY)
        if area.holes:
            holes = shapely.union_all([shapely.Polygon(ring) for ring in area.holes])
            free = free.difference(_keep_off(holes, depth_m, OBSTACLES))
        parts = list_polygons(free if keep_out is None else free.difference(keep_out))
        if not parts:
            circle_m = 2.0 * shape.turn_radius_m
            raise MissionError(NoPlaceToTurn(2.0 * depth_m, circle_m, request.margin_m))
        self.region = _choose(parts, request.start_map_m, depth_m)
        self.left_out = [part for part in parts if part is not self.region]
        self.drivable = self.region.buffer(TOUCH_M, join_style="mitre")
        shapely.prepare(self.drivable)

    def measure_short_m(self, lines: Sequence[FloatArray]) -> float:
        """Measure how much nearer to an edge than they may lines (N, 2) come; 0 where they do not.

        The robot counts as its turning circle.
        """
        import shapely

        drawn = np.array([shapely.LineString(line) for line in lines])
        nearest_m = float(np.min(shapely.distance(self.edge, drawn), initial=math.inf))
        return max(0.0, self.away_m - TOUCH_M - nearest_m)

    def nearest(self, place: MapPoint) -> MapPoint:
        """Find the place itself, or where the region is nearest to it."""
        import shapely

        here = shapely.Point(place)
        if self.drivable.covers(here):
            return place
        x_m, y_m = shapely.get_coordinates(shapely.shortest_line(here, self.region))[1]
        return float(x_m), float(y_m)

    @staticmethod
    def inset(shape: BaseGeometry, depth_m: float) -> BaseGeometry:
        return shape.buffer(-depth_m, join_style="mitre", mitre_limit=MITRE_LIMIT)

    def remove(self, obstacle: BaseGeometry) -> None:
        """Keep ways out of a further area; the places to turn stay inside what remains."""
        import shapely

        parts = list_polygons(self.region.difference(obstacle))
        if not parts:
            raise MissionError(NoHeadland())
        self.region = max(parts, key=lambda part: part.area)
        self.drivable = self.region.buffer(TOUCH_M, join_style="mitre")
        shapely.prepare(self.drivable)


def draw_crop_strips(area: FieldArea, clear_m: float) -> BaseGeometry:
    """Draw the ground within `clear_m` of any row of crop."""
    import shapely

    lines = [shapely.LineString(row) for row in area.standing]
    return shapely.union_all(shapely.buffer(lines, clear_m, cap_style="square", join_style="mitre"))


def measure_crop_clearance_m(area: FieldArea, shape: Footprint, request: PlanRequest) -> float:
    """Measure from a row of crop to the middle of a robot that turns in place beside it.

    Where no rows are worked, neither does its tool reach them.
    """
    tool_m = 0.0 if area.rows else request.implement_width_m / 2.0
    return max(shape.wheel_turn_radius_m, tool_m) + request.turn_clearance_m


def _keep_off(ground: BaseGeometry, by_m: float, outline: _Outline) -> BaseGeometry:
    """Draw areas larger, or smaller by a negative number, by no less than that, with few points."""
    import shapely

    edge = ground.boundary
    shapely.prepare(edge)
    drawn_m = by_m
    for _ in range(MAX_REDRAWN):
        rounded = ground.buffer(drawn_m, quad_segs=outline.quarter_segments)
        drawn = rounded.simplify(outline.simplify_m)
        short_m = 0.0 if drawn.is_empty else abs(by_m) - float(edge.distance(drawn.boundary))
        if short_m <= TOUCH_M / 2.0:
            break
        drawn_m += math.copysign(short_m, by_m)
    return drawn


def list_polygons(shape: BaseGeometry) -> list[shapely.Polygon]:
    """List the areas in a geometry, without lines, points and specks."""
    import shapely

    found = shapely.get_parts(shapely.get_parts(shape)).tolist() if not shape.is_empty else []
    return [part for part in found if part.geom_type == "Polygon" and part.area > 1e-4]


def _choose(
    parts: list[shapely.Polygon], start_map_m: MapPoint | None, depth_m: float
) -> shapely.Polygon:
    import shapely

    if start_map_m is None:
        return max(parts, key=lambda part: part.area)
    start = shapely.Point(start_map_m)
    nearest = min(parts, key=lambda part: (part.distance(start), -part.area))
    if nearest.distance(start) > TOUCH_M:
        raise MissionError(StartOutside(*start_map_m, float(nearest.distance(start)), depth_m))
    return nearest
