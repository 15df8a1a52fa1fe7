"""Plan a field: free space, headland, swaths or rows, their order and the ways between."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from agribot.autonomy.plan.coverage.area import (
    FieldArea,
    FieldPlan,
    Leg,
    LegKind,
    MapLine,
    PlanRequest,
    TurnStyle,
)
from agribot.autonomy.plan.coverage.free_space import (
    ROUNDING_M,
    TOUCH_M,
    FreeSpace,
    draw_crop_strips,
    list_polygons,
    measure_crop_clearance_m,
)
from agribot.autonomy.plan.coverage.row_room import check_row_room
from agribot.autonomy.plan.coverage.swaths import (
    add_room,
    group_cells,
    lay_swaths,
    rotate,
    search_yaw_rad,
)
from agribot.autonomy.plan.coverage.tasks import (
    CoverageTask,
    make_cell_task,
    make_ring_tasks,
    make_row_task,
    order_tasks,
)
from agribot.autonomy.plan.coverage.turns import plan_arc_turn, plan_three_point_turn, yaw_rad
from agribot.autonomy.plan.coverage.ways import Ways
from agribot.autonomy.plan.ways.footprint import Footprint
from agribot.core.errors import MissionError
from agribot.core.facts import ManyObstacles, ManySwaths, OverlapWide, RowWithoutRoom
from agribot.core.messages import FloatArray, MapPoint
from agribot.core.pose import Pose2

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

MAX_SWATHS = 20000
# Most holes, of nine corners each: the ways between them took 5 CPU seconds and 130 MB.
MAX_HOLES = 200
STRAIGHT_M = 0.1  # an ab_line that bends by less is straight
BEYOND_ROW_M, NEAR_M = 0.05, 1e-3


def plan_field(area: FieldArea, shape: Footprint, request: PlanRequest) -> FieldPlan:
    """Work a whole field; nothing here is trusted, `certify_plan` decides.

    Raises: MissionError: the field cannot be worked with this robot, and why.
    """
    if request.spacing_m <= 0.0:
        raise MissionError(OverlapWide(request.overlap_m, request.implement_width_m))
    if len(area.holes) > MAX_HOLES:
        raise MissionError(ManyObstacles(len(area.holes), MAX_HOLES))
    space, swath_yaw_rad, tasks = _lay_out(area, shape, request)
    ways = Ways(space.region, space.drivable)
    working = order_tasks(tasks, request.start_map_m, ways.way)
    legs = _join([leg for _, leg in working], request, ways, space.drivable)
    if area.rows:
        legs = _number(legs, [task for task, _ in working])
    else:
        legs = _number(legs, list(range(len(working))))
    warnings = (
        *([area.left_out] if area.left_out else ()),
        *_describe_bend(area.ab_line),
        *_describe_left_out(space),
    )
    return FieldPlan(legs=tuple(legs), swath_yaw_rad=swath_yaw_rad, warnings=warnings)


def _lay_out(
    area: FieldArea, shape: Footprint, request: PlanRequest
) -> tuple[FreeSpace, float, list[CoverageTask]]:
    """Find the free space and what is to be worked in it; bends cut by rounding get more room."""
    clear_m = measure_crop_clearance_m(area, shape, request)
    strips = draw_crop_strips(area, clear_m)
    keep_out = strips if area.crop and not area.rows else None
    spare_m = 0.0
    while True:
        space = FreeSpace(area, shape, request, keep_out, spare_m)
        if area.rows:
            _check_row_room(area, shape, request)
            return space, *_make_row_tasks(area, clear_m, strips, space)
        swath_yaw_rad, tasks = _make_area_tasks(area, request, space)
        short_m = space.measure_short_m([line for _, variants in tasks for line in variants[0]])
        if short_m == 0.0 or spare_m >= ROUNDING_M:
            return space, swath_yaw_rad, tasks
        spare_m = min(spare_m + short_m + TOUCH_M, ROUNDING_M)


def _check_row_room(area: FieldArea, shape: Footprint, request: PlanRequest) -> None:
    wheels_left_m = [left_m for _, left_m in shape.wheel_xy_body_m]
    width_m, clear_m = 2.0 * shape.wheel_half_width_m, request.plant_clearance_m
    check_row_room(area.rows, area.standing, wheels_left_m, width_m, clear_m, shape.machine)


def _describe_bend(line: MapLine) -> tuple[str, ...]:
    """Say that swaths are straight where the line that they are to run along is not."""
    import shapely

    if len(line) < 3:
        return ()
    chord = shapely.LineString((line[0], line[-1]))
    bent_m = float(np.max(shapely.distance(chord, shapely.points(line))))
    if bent_m <= STRAIGHT_M:
        return ()
    return (
        f"the ab_line lies up to {bent_m:.2f} m beside the straight line from its first to its "
        "last point; swaths run straight, along that",
    )


def _describe_left_out(space: FreeSpace) -> tuple[str, ...]:
    found = []
    for part in space.left_out:
        place = part.representative_point()
        found.append(
            f"{part.area:.1f} m2 around East {place.x:.1f} m, North {place.y:.1f} m cannot be "
            "reached: the passage is narrower than the robot's turning circle"
        )
    return tuple(found)


def _make_area_tasks(
    area: FieldArea, request: PlanRequest, space: FreeSpace
) -> tuple[float, list[CoverageTask]]:
    """Headland rings from the edge inwards, then swaths over what the rings leave."""
    import shapely

    rings: list[CoverageTask] = []
    work: BaseGeometry = space.region
    inner: BaseGeometry = space.region
    half_m = request.implement_width_m / 2.0
    slivers = []
    for number in range(request.passes(has_rows=False)):
        edge = FreeSpace.inset(space.region, number * request.spacing_m)
        if not list_polygons(edge):
            break
        rings += make_ring_tasks(shapely.MultiPolygon(list_polygons(edge)), space.away_m)
        if number:  # the part of this ring's band that it does not reach
            slivers += list_polygons(work.difference(edge.buffer(half_m + 1e-3)))
        work, inner = FreeSpace.inset(edge, request.spacing_m / 2.0), edge
    work = shapely.MultiPolygon(
        list_polygons(shapely.unary_union([*list_polygons(work), *slivers]))
    )
    if slivers:
        inner = space.region
    if work.is_empty:
        return request.swath_yaw_rad or 0.0, rings
    swath_yaw_rad, anchor_m = _choose_direction(area, request, work)
    spacing_m = request.spacing_m
    swaths = lay_swaths(work, inner, swath_yaw_rad, spacing_m, anchor_m)
    if len(swaths) > MAX_SWATHS:
        raise MissionError(ManySwaths(len(swaths), MAX_SWATHS))
    tool_x_m = request.tool_x_m
    swaths = add_room(swaths, space.drivable, swath_yaw_rad, abs(tool_x_m))
    found = [make_cell_task(cell, swath_yaw_rad, tool_x_m) for cell in group_cells(swaths)]
    return swath_yaw_rad, rings + found


def _choose_direction(
    area: FieldArea, request: PlanRequest, work: BaseGeometry
) -> tuple[float, float | None]:
    """Direction of the swaths and where across it one of them lies (an AB line), if anywhere."""
    if area.ab_line:
        yaw = yaw_rad(area.ab_line[0], area.ab_line[-1])
        across = rotate(np.array(area.ab_line[:1]), -yaw)[0, 1]
        return yaw, float(across)
    if request.swath_yaw_rad is not None:
        return request.swath_yaw_rad, None
    return search_yaw_rad(work, request.spacing_m), None


def _make_row_tasks(
    area: FieldArea, clear_m: float, strips: BaseGeometry, space: FreeSpace
) -> tuple[float, list[CoverageTask]]:
    """Make tasks of the rows, all crop taken out of the ground on which the robot may turn."""
    import shapely

    whole_m = math.hypot(*np.ptp(np.reshape(strips.bounds, (2, 2)), axis=0))

    def measure_beyond_m(before: FloatArray, end: FloatArray) -> float:
        """Measure from the end of a row to where no row's strip is."""
        ahead = (end - before) / np.hypot(*(end - before))
        ray = shapely.LineString([end + NEAR_M * ahead, end + whole_m * ahead])
        near = shapely.Point(ray.coords[0])
        first = min(shapely.get_parts(ray.intersection(strips)).tolist(), key=near.distance)
        return NEAR_M + float(first.length) + BEYOND_ROW_M

    tasks = [make_row_task(row, number, measure_beyond_m) for number, row in enumerate(area.rows)]
    for number, (_, variants) in enumerate(tasks):
        line = shapely.LineString(variants[0][0])
        outside = line.difference(space.drivable)
        if not outside.is_empty:
            place = outside.representative_point()
            room_m = clear_m + BEYOND_ROW_M
            raise MissionError(RowWithoutRoom(number + 1, room_m, place.x, place.y))
    space.remove(strips)
    first = area.rows[0]
    return yaw_rad(first[0], first[-1]), tasks


def _join(
    working: list[Leg], request: PlanRequest, ways: Ways, drivable: BaseGeometry
) -> list[Leg]:
    """Join the working legs with turns and links between them."""
    legs: list[Leg] = []
    if request.start_map_m is not None:
        legs += _make_link(request.start_map_m, _read_point(working[0], 0), ways)
    for number, leg in enumerate(working):
        legs.append(leg)
        if number + 1 < len(working):
            legs += _plan_turn(leg, working[number + 1], request, ways, drivable)
    return legs


def _plan_turn(
    leg: Leg, after: Leg, request: PlanRequest, ways: Ways, drivable: BaseGeometry
) -> list[Leg]:
    start, end = _read_point(leg, -1), _read_point(after, 0)
    if math.dist(start, end) < 1e-6:
        return []
    from_pose = Pose2(*start, yaw_rad(leg.xy_map_m[-2], leg.xy_map_m[-1]))
    to_pose = Pose2(*end, yaw_rad(after.xy_map_m[0], after.xy_map_m[1]))
    return _plan_curve(from_pose, to_pose, request.turns, drivable) or _make_link(start, end, ways)


def _plan_curve(start: Pose2, end: Pose2, style: TurnStyle, drivable: BaseGeometry) -> list[Leg]:
    """Plan the turn in the wanted style; nothing where the robot has to turn in place."""
    if style == "pivot":
        return []
    three = plan_three_point_turn(start, end, drivable) if style == "three-point" else None
    if three is not None:
        kinds: tuple[LegKind, ...] = ("arc", "reverse", "arc")
        return [Leg(kind=kind, xy_map_m=xy) for kind, xy in zip(kinds, three, strict=True)]
    points = plan_arc_turn(start, end, drivable, is_wanted=style != "auto")
    return [] if points is None else [Leg(kind="arc", xy_map_m=points)]


def _make_link(start: MapPoint, end: MapPoint, ways: Ways) -> list[Leg]:
    if math.dist(start, end) < 1e-6:
        return []
    return [Leg(kind="link", xy_map_m=np.array(ways.way(start, end)))]


def _read_point(leg: Leg, index: int) -> MapPoint:
    x_m, y_m = leg.xy_map_m[index]
    return float(x_m), float(y_m)


def _number(legs: list[Leg], numbers: list[int]) -> list[Leg]:
    rows = iter(numbers)
    return [msgspec.structs.replace(leg, row=next(rows)) if leg.tool_on else leg for leg in legs]
