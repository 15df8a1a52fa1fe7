"""A plan over a drawn field, worked out in a process of its own and shown before it is driven."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from agribot.app.field_work import choose_width_m
from agribot.autonomy.plan.coverage.area import FieldArea, MapLine, PlanRequest
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
from agribot.autonomy.plan.coverage.planner import plan_field
from agribot.autonomy.plan.coverage.tool_gaps import measure_gaps_m2, warn_of_gaps
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.autonomy.plan.ways.speed import find_most_mps, limit_speeds
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.fact_text import render
from agribot.core.facts import AnyFact
from agribot.core.geo import MapFrame
from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec
from agribot.gis.field_file import parse_field
from agribot.gis.geojson import KINDS, parse_features
from agribot.gis.ground import GroundFault
from agribot.gis.plan_file import SavedPlan, format_plan
from agribot.ui import wire
from agribot.ui.ground import field_of

SHOWN_STEP_M = 0.2
SAME_ROW_M = 0.02  # distance of a row of the map from one that was drawn over it


class Made(NamedTuple):
    """`answer` is for the page, `text` the file of a certified plan, `field` what a map shows."""

    answer: wire.PlanReply
    text: str = ""
    is_crop_gone: bool = False
    field: wire.Field | None = None


def make_plan(
    wanted: wire.PlanWish, config: RunConfig, robot: RobotSpec, crop: Sequence[Sequence[wire.Vec2]]
) -> Made:
    """Plan a field among the `crop` rows that stand on the map."""
    try:
        return _plan(wanted, config, robot, crop)
    except GroundFault as fault:
        return _refuse(fault.bare, fault.at_map_m)
    except MissionError as error:
        return _refuse(error.fact)


def _refuse(fact: AnyFact, at_map_m: wire.Vec2 | None = None) -> Made:
    reason = wire.FieldReason(text=render(fact), text_fact=fact, at_map_m=at_map_m)
    return Made(wire.PlanReply(ok=False, reasons=[reason]))


def _plan(
    wanted: wire.PlanWish, config: RunConfig, robot: RobotSpec, crop: Sequence[Sequence[wire.Vec2]]
) -> Made:
    found = [f for f in parse_features(wanted.field, "the field") if f.kind in {*KINDS, ""}]
    area, datum = parse_field(found, "the field", config.field.datum)
    if not wanted.is_crop_gone:
        area = msgspec.structs.replace(area, crop=(*area.crop, *_find_unworked(crop, area)))
    yaw_deg = wanted.swath_yaw_deg
    request = PlanRequest(
        implement_width_m=choose_width_m(wanted.implement_width_m, robot),
        overlap_m=wanted.overlap_m,
        margin_m=area.choose_margin_m(wanted.margin_m),
        headland_passes=wanted.headland_passes,
        swath_yaw_rad=None if yaw_deg is None else math.radians(yaw_deg),
        tool_x_m=robot.tool_x_m,
    )
    shape = measure_footprint(robot, request.implement_width_m)
    plan = warn_of_gaps(plan_field(area, shape, request), area, request, robot)
    certificate = certify_plan(plan, area, shape, request)
    frame = MapFrame(datum)
    gaps_m2 = measure_gaps_m2(plan.legs, area, request, robot)
    worked_m2 = certificate.covered_area_m2 - gaps_m2
    answer = wire.PlanReply(
        ok=certificate.ok,
        reasons=[
            wire.FieldReason(text=p.message, text_fact=p.fact, at_map_m=(p.east_m, p.north_m))
            for p in certificate.problems
        ],
        warnings=list(plan.warnings),
        length_m=round(certificate.length_m, 2),
        area_m2=round(worked_m2, 2),
        path=[point for leg in plan.legs for point in _thin_leg(leg.xy_map_m, frame)],
        certificate=msgspec.to_builtins(certificate),
    )
    if not certificate.ok:
        return Made(answer)
    work = FieldWork(plan, area, shape, request)
    speeds = limit_speeds(config.mission, find_most_mps(config.safety, robot.drive))
    answer = msgspec.structs.replace(answer, time_s=round(work.measure_time_s(speeds), 1))
    text = format_plan(SavedPlan(plan, area, request, datum), certificate)
    is_crop_gone = wanted.is_crop_gone and bool(crop)
    return Made(answer, text, is_crop_gone, field_of(config, work.rows, area=area))


def _find_unworked(crop: Sequence[Sequence[wire.Vec2]], area: FieldArea) -> list[MapLine]:
    """Find the rows on the map that are not those of the field."""
    import shapely

    known = shapely.union_all(
        shapely.buffer([shapely.LineString(row) for row in area.standing], SAME_ROW_M)
    )
    return [tuple(row) for row in crop if not known.covers(shapely.LineString(row))]


def _thin_leg(xy_map_m: FloatArray, frame: MapFrame) -> list[wire.Vec2]:
    """Longitude and latitude of a leg's points, no nearer than a drawing needs."""
    kept = [xy_map_m[0]]
    for point in xy_map_m[1:-1]:
        if math.dist(point, kept[-1]) >= SHOWN_STEP_M:
            kept.append(point)
    shown = []
    for x_m, y_m in (*kept, xy_map_m[-1]):
        lat_deg, lon_deg, _ = frame.geodetic_from_map(float(x_m), float(y_m))
        shown.append((round(lon_deg, 9), round(lat_deg, 9)))
    return shown
