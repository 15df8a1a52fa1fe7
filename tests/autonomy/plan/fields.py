"""Fields for the tests of the field planner."""

from __future__ import annotations

import math

from agribot.autonomy.plan.coverage.area import FieldArea, FieldPlan, PlanRequest
from agribot.autonomy.plan.coverage.plan_certificate import Certificate, certify_plan
from agribot.autonomy.plan.coverage.planner import plan_field
from agribot.autonomy.plan.ways.footprint import Footprint

SHAPE = Footprint(
    front_m=0.35,
    rear_m=0.34,
    half_width_m=0.42,
    wheel_xy_body_m=((-0.25, -0.39), (-0.25, 0.39), (0.25, -0.39), (0.25, 0.39)),
    wheel_half_width_m=0.025,
    wheel_radius_m=0.09,
)
SQUARE = FieldArea(boundary=((0.0, 0.0), (20.0, 0.0), (20.0, 15.0), (0.0, 15.0)))
WITH_HOLE = FieldArea(
    boundary=SQUARE.boundary, holes=(((8.0, 5.0), (12.0, 5.5), (11.5, 9.0), (7.5, 8.0)),)
)
ROWS = FieldArea(
    boundary=((-5.0, -5.0), (12.0, -5.0), (12.0, 16.0), (-5.0, 16.0)),
    rows=tuple(((float(x), 0.0), (float(x), 10.0)) for x in range(6)),
)
REQUEST = PlanRequest(implement_width_m=0.8)
ROW_REQUEST = PlanRequest(implement_width_m=0.8, headland_passes=0)


def ten_hectares() -> FieldArea:
    pond = tuple((220 + 12 * math.cos(k * math.tau / 24), 180 + 12 * math.sin(k * math.tau / 24))
                 for k in range(24))  # fmt: skip
    return FieldArea(
        boundary=((0.0, 0.0), (330.0, -15.0), (345.0, 300.0), (160.0, 330.0), (-5.0, 290.0)),
        holes=(((100.0, 100.0), (120.0, 95.0), (125.0, 120.0), (105.0, 118.0)), pond),
    )


def certified(
    area: FieldArea, request: PlanRequest = REQUEST, shape: Footprint = SHAPE
) -> tuple[FieldPlan, Certificate]:
    plan = plan_field(area, shape, request)
    return plan, certify_plan(plan, area, shape, request)
