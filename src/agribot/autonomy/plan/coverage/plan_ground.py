"""Ground that a tool can reach, and ground that it passed; for the certificate only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from agribot.autonomy.plan.coverage.area import FieldArea, FieldPlan, Leg, PlanRequest
from agribot.autonomy.plan.coverage.free_space import (
    draw_crop_strips,
    measure_crop_clearance_m,
)
from agribot.autonomy.plan.coverage.plan_sweep import trace_tool
from agribot.autonomy.plan.ways.footprint import Footprint
from agribot.core.messages import FloatArray

if TYPE_CHECKING:
    import shapely
    from shapely.geometry.base import BaseGeometry


def find_reachable(
    plan: FieldPlan, area: FieldArea, field: shapely.Polygon, shape: Footprint, request: PlanRequest
) -> BaseGeometry:
    """Find the ground that the tool can pass: beside every straight stretch that can be driven.

    It can drive where it keeps the margin and can turn in place, so that it also gets away
    again; of several separate grounds the one counts on which the work takes place. A tool that
    is off the middle passes the ends of a stretch in one direction only: beside the edge they do
    not count. In a field of rows the target is the strips along the rows.
    """
    import shapely

    half_m = request.implement_width_m / 2.0
    if area.rows:
        strips = shapely.buffer(
            np.array([shapely.LineString(row) for row in area.rows]), half_m, cap_style="flat"
        )
        return shapely.union_all(strips)
    standing: BaseGeometry = field.buffer(-(shape.turn_radius_m + request.margin_m), quad_segs=16)
    if area.crop:
        clear_m = measure_crop_clearance_m(area, shape, request)
        standing = standing.difference(draw_crop_strips(area, clear_m))
    parts = shapely.get_parts(standing)
    worked = next((leg for leg in plan.legs if leg.tool_on), None)
    if len(parts) > 1 and worked is not None:
        away_m = np.asarray(shapely.distance(parts, shapely.LineString(worked.xy_map_m)))
        standing = parts[int(np.argmin(away_m))]
    if standing.is_empty:
        return standing
    rings = [
        ring for part in shapely.get_parts(standing) for ring in (part.exterior, *part.interiors)
    ]
    corners = [shapely.get_coordinates(ring) for ring in rings]
    edges = np.concatenate([np.stack([xy[:-1], xy[1:]], axis=1) for xy in corners])
    lines = np.asarray(shapely.linestrings(_shorten(edges, abs(request.tool_x_m))))
    beside = np.asarray(shapely.buffer(lines, half_m, cap_style="flat"))
    return shapely.union_all([standing, *beside]).intersection(field)


def _shorten(edges: FloatArray, by_m: float) -> FloatArray:
    """Shorten lines (N, 2, 2) by `by_m` at both ends; those that are all ends are left out."""
    along = edges[:, 1] - edges[:, 0]
    length_m = np.hypot(*along.T)
    kept = length_m > 2.0 * by_m
    cut = along[kept] * (by_m / length_m[kept])[:, None]
    return np.stack([edges[kept, 0] + cut, edges[kept, 1] - cut], axis=1)


def find_covered(
    legs: tuple[Leg, ...], field: shapely.Polygon, request: PlanRequest
) -> tuple[BaseGeometry, float]:
    """Find the ground that the tool passed, and the share of it that it passed more than once."""
    import shapely

    passed = [trace_tool(leg.xy_map_m, request.tool_x_m) for leg in legs if leg.tool_on]
    lines = np.array([shapely.LineString(xy) for xy in passed])
    if not len(lines):
        return shapely.Polygon(), 0.0
    half_m = request.implement_width_m / 2.0
    bands = np.asarray(shapely.buffer(lines, half_m, cap_style="flat", quad_segs=4))
    union = shapely.union_all(bands)
    if union.area <= 0.0:
        return union, 0.0
    overlap = (float(np.sum(shapely.area(bands))) - float(union.area)) / float(union.area)
    return shapely.intersection(union, field), overlap
