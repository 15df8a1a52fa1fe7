"""Independent check of a field plan: nothing here knows how the plan was made.

The robot is moved along every leg as the rectangle of its footprint, turning in place at every
sharp bend; the union of the ground that the tool passes is compared with the ground that the tool
can reach.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from agribot.autonomy.plan.coverage.area import FieldArea, FieldPlan, Leg, PlanRequest
from agribot.autonomy.plan.coverage.plan_ground import find_covered, find_reachable
from agribot.autonomy.plan.coverage.plan_problem import PlanProblem, report, report_at
from agribot.autonomy.plan.coverage.plan_sweep import (
    measure_bends_radpm,
    orient_line,
    sweep_footprint,
    trace_wheels,
)
from agribot.autonomy.plan.ways.curves import MIN_RADIUS_M
from agribot.autonomy.plan.ways.footprint import Footprint
from agribot.core.facts import (
    GroundMissed,
    LegBroken,
    LegsApart,
    LegsMissing,
    LegTight,
    NearEdge,
    NothingReachable,
    ReachesOutside,
    ToolOnCrop,
    WheelNearRow,
)
from agribot.core.messages import MapPoint

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

ROUNDED_M = 1e-4  # places in a plan file
JOINT_M = 1e-3  # legs meet this closely; a plan file keeps a tenth of a millimetre
CURVATURE_SLACK_RATIO = 1.05  # tolerance of the curvature: arcs are checked on their chords
MAX_PROBLEMS = 20


class Certificate(msgspec.Struct, frozen=True, kw_only=True):
    """`clearance_m` is a lower bound of the distance from the footprint to every edge.

    `coverage_ratio` is the worked part of the ground that the tool can reach; `field_ratio` of
    the whole field (None for crop rows, where only the strips of the rows are to be worked).
    """

    ok: bool
    problems: tuple[PlanProblem, ...]
    clearance_m: float
    outside_m: float
    wheel_row_clearance_m: float | None
    max_curvature_radpm: float
    coverage_ratio: float
    field_ratio: float | None
    overlap_ratio: float
    field_area_m2: float
    reachable_area_m2: float
    covered_area_m2: float
    length_m: float
    working_length_m: float
    working_legs: int
    pivots: int


def certify_plan(
    plan: FieldPlan, area: FieldArea, shape: Footprint, request: PlanRequest
) -> Certificate:
    """Check every rule and name every place; `ok` only without a problem."""
    import shapely

    problems = _check_joints(plan.legs)
    if any(math.isnan(problem.east_m) for problem in problems):
        return _refuse(problems)
    field = shapely.Polygon(area.boundary, area.holes)
    bends, sharpest = _check_bends(plan.legs)
    problems += bends
    clearance_m, outside_m, found = _check_edges(plan.legs, field, shape, request.margin_m)
    problems += found or _check_margin(plan.legs, clearance_m, field, request)
    row_clearance_m, found = _check_rows(plan.legs, area, shape, request)
    problems += found
    target = find_reachable(plan, area, field, shape, request)
    covered, overlap_ratio = find_covered(plan.legs, field, request)
    coverage_ratio, found = _check_coverage(covered, target, request)
    problems += found + _check_tool(covered, area)
    working = [leg for leg in plan.legs if leg.tool_on]
    return Certificate(
        ok=not problems,
        problems=tuple(problems[:MAX_PROBLEMS]),
        clearance_m=clearance_m,
        outside_m=outside_m,
        wheel_row_clearance_m=row_clearance_m,
        max_curvature_radpm=sharpest,
        coverage_ratio=coverage_ratio,
        field_ratio=None if area.rows else float(covered.area / field.area),
        overlap_ratio=overlap_ratio,
        field_area_m2=float(field.area),
        reachable_area_m2=float(target.area),
        covered_area_m2=float(covered.area),
        length_m=sum(leg.length_m for leg in plan.legs),
        working_length_m=sum(leg.length_m for leg in working),
        working_legs=len(working),
        pivots=_count_pivots(plan.legs),
    )


def check_ways(
    legs: tuple[Leg, ...], area: FieldArea, shape: Footprint, request: PlanRequest, start: MapPoint
) -> list[PlanProblem]:
    """Check ways without work: edges, holes, wheels on crop.

    The ground under the robot is forgiven: it stands there already, and must be able to leave.
    """
    import shapely

    field = shapely.Polygon(area.boundary, area.holes).union(
        shapely.Point(start).buffer(2.0 * shape.turn_radius_m)
    )
    _, _, edges = _check_edges(legs, field, shape)
    return [*edges, *check_crop(legs, area, shape, request, start)]


def check_crop(
    legs: tuple[Leg, ...], area: FieldArea, shape: Footprint, request: PlanRequest, start: MapPoint
) -> list[PlanProblem]:
    """Check wheels on crop along ways without work; that under the robot is forgiven."""
    _, rows = _check_rows(legs, area, shape, request)
    away_m = 2.0 * shape.turn_radius_m
    return [p for p in rows if math.dist((p.east_m, p.north_m), start) > away_m]


def _refuse(problems: list[PlanProblem]) -> Certificate:
    """Refuse a plan that is no way at all."""
    return Certificate(
        ok=False, problems=tuple(problems), clearance_m=0.0, outside_m=0.0,
        wheel_row_clearance_m=None, max_curvature_radpm=0.0, coverage_ratio=0.0, field_ratio=None,
        overlap_ratio=0.0, field_area_m2=0.0, reachable_area_m2=0.0, covered_area_m2=0.0,
        length_m=0.0, working_length_m=0.0, working_legs=0, pivots=0,
    )  # fmt: skip


def _check_joints(legs: tuple[Leg, ...]) -> list[PlanProblem]:
    """Finite numbers, and every leg begins where the one before it ended."""
    found = []
    for number, leg in enumerate(legs):
        if not np.isfinite(leg.xy_map_m).all() or len(leg.xy_map_m) < 2:
            return [report("path", LegBroken(number))]
        if number:
            gap_m = math.dist(legs[number - 1].xy_map_m[-1], leg.xy_map_m[0])
            if gap_m > JOINT_M:
                found.append(report_at("path", LegsApart, leg.xy_map_m[0], gap_m=gap_m))
    return found if legs else [report("path", LegsMissing())]


def _check_bends(legs: tuple[Leg, ...]) -> tuple[list[PlanProblem], float]:
    """Only links may turn in place: there the tool is off."""
    found, sharpest = [], 0.0
    limit = CURVATURE_SLACK_RATIO / MIN_RADIUS_M
    for leg in legs:
        if leg.kind == "link" or len(leg.xy_map_m) < 3:
            continue
        curvature = measure_bends_radpm(leg.xy_map_m)
        at = int(np.argmax(curvature))
        sharpest = max(sharpest, float(curvature[at]))
        if curvature[at] > limit:
            found.append(
                report_at("curvature", LegTight, leg.xy_map_m[at + 1],
                           bend_radpm=float(curvature[at]), limit_radpm=limit,
                           is_working=leg.tool_on)
            )  # fmt: skip
    return found, sharpest


def _check_edges(
    legs: tuple[Leg, ...], field: BaseGeometry, shape: Footprint, margin_m: float = 0.0
) -> tuple[float, float, list[PlanProblem]]:
    """Smallest clearance of the footprint, length of way outside the field, and where.

    A leg that keeps the turning circle off every edge by the margin is clear whichever way the
    robot looks; along the others the rectangle itself is moved.
    """
    import shapely

    shapely.prepare(field)
    edge = field.boundary
    shapely.prepare(edge)
    lines = np.array([shapely.LineString(leg.xy_map_m) for leg in legs])
    inside = np.asarray(shapely.covers(field, lines))
    away_m = np.asarray(shapely.distance(edge, lines)) - shape.turn_radius_m
    is_clear = inside & (away_m >= margin_m)
    clearance_m = float(away_m[is_clear].min(initial=math.inf))
    found, outside_m = [], 0.0
    for number in np.flatnonzero(~is_clear):
        xy, before, after = orient_line(legs, int(number))
        boxes = np.asarray(shapely.polygons(sweep_footprint(xy, shape, before, after)))
        is_out = ~np.asarray(shapely.covers(field, boxes))
        if not is_out.any():
            clearance_m = min(clearance_m, float(np.min(shapely.distance(edge, boxes))))
            continue
        clearance_m = min(clearance_m, 0.0)
        outside_m += float(shapely.length(shapely.difference(lines[number], field)))
        beyond = shapely.difference(boxes[is_out], field)
        worst = beyond[int(np.argmax(shapely.area(beyond)))]
        place = worst.representative_point()
        depth_m = float(shapely.hausdorff_distance(worst, shapely.intersection(worst, edge)))
        found.append(
            report_at("footprint", ReachesOutside, (place.x, place.y), depth_m=depth_m,
                       leg_number=int(number), leg_kind=legs[number].kind)
        )  # fmt: skip
    return clearance_m, outside_m, found


def _check_margin(
    legs: tuple[Leg, ...], clearance_m: float, field: BaseGeometry, request: PlanRequest
) -> list[PlanProblem]:
    """Check that the footprint keeps the margin from every edge."""
    if clearance_m >= request.margin_m - ROUNDED_M:
        return []
    import shapely

    lines = np.array([shapely.LineString(leg.xy_map_m) for leg in legs])
    number = int(np.argmin(shapely.distance(field.boundary, lines)))
    near = shapely.shortest_line(field.boundary, lines[number])
    return [
        report_at("margin", NearEdge, shapely.get_coordinates(near)[0], clearance_m=clearance_m,
                   margin_m=request.margin_m, leg_number=number, leg_kind=legs[number].kind)
    ]  # fmt: skip


def _check_rows(
    legs: tuple[Leg, ...], area: FieldArea, shape: Footprint, request: PlanRequest
) -> tuple[float | None, list[PlanProblem]]:
    """Wheel edges to crop rows."""
    import shapely

    if not area.standing:
        return None, []
    rows = shapely.MultiLineString([list(row) for row in area.standing])
    shapely.prepare(rows)
    smallest_m, found = math.inf, []
    for number, leg in enumerate(legs):
        xy, before, after = orient_line(legs, number)
        traces = np.asarray(shapely.linestrings(trace_wheels(xy, shape, before, after)))
        away_m = np.asarray(shapely.distance(rows, traces)) - shape.wheel_half_width_m
        at = int(np.argmin(away_m))
        smallest_m = min(smallest_m, float(away_m[at]))
        if away_m[at] < request.plant_clearance_m - JOINT_M:
            place = shapely.shortest_line(rows, traces[at])
            found.append(
                report_at("wheels", WheelNearRow, shapely.get_coordinates(place)[0],
                           clearance_m=float(away_m[at]), needed_m=request.plant_clearance_m,
                           leg_number=number, leg_kind=leg.kind)
            )  # fmt: skip
    return smallest_m, found


def _check_tool(covered: BaseGeometry, area: FieldArea) -> list[PlanProblem]:
    """Check that a tool that works no rows works no crop."""
    import shapely

    if area.rows or not area.crop:
        return []
    hit = shapely.intersection(covered, shapely.MultiLineString([list(row) for row in area.crop]))
    if hit.length == 0.0:
        return []
    place = shapely.get_coordinates(hit)[0]
    return [report_at("crop", ToolOnCrop, place, length_m=float(hit.length))]


def _check_coverage(
    covered: BaseGeometry, target: BaseGeometry, request: PlanRequest
) -> tuple[float, list[PlanProblem]]:
    import shapely

    if target.is_empty:
        return 0.0, [report("coverage", NothingReachable())]
    missed = shapely.difference(target, covered)
    ratio = max(0.0, 1.0 - float(missed.area / target.area))
    if ratio >= request.min_coverage_ratio:
        return ratio, []
    parts = shapely.get_parts(missed)
    worst = parts[int(np.argmax(shapely.area(parts)))]
    place = worst.representative_point()
    return ratio, [
        report_at("coverage", GroundMissed, (place.x, place.y), worked_percent=100 * ratio,
                   needed_percent=100 * request.min_coverage_ratio, gap_m2=float(worst.area))
    ]  # fmt: skip


def _count_pivots(legs: tuple[Leg, ...]) -> int:
    """Count turns in place of more than ten degrees: between legs and at the corners of links."""
    count, course = 0, None
    for leg in legs:
        steps = np.diff(leg.xy_map_m, axis=0)
        yaw = np.arctan2(steps[:, 1], steps[:, 0]) + leg.is_reverse * math.pi
        if course is not None:
            count += abs(math.remainder(float(yaw[0]) - course, math.tau)) > math.radians(10.0)
        if leg.kind == "link":
            turned = np.abs(np.angle(np.exp(1j * np.diff(yaw))))
            count += int(np.count_nonzero(turned > math.radians(10.0)))
        course = float(yaw[-1])
    return count
