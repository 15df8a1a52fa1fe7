"""Ground that a robot's own tool leaves out of a plan whose passes are laid for a wider one."""

from __future__ import annotations

import msgspec

from agribot.autonomy.plan.coverage.area import FieldArea, FieldPlan, Leg, PlanRequest
from agribot.autonomy.plan.coverage.plan_ground import find_covered
from agribot.core.robot import RobotSpec

SAME_WIDTH_M = 1e-3


def warn_of_gaps(
    plan: FieldPlan, area: FieldArea, request: PlanRequest, robot: RobotSpec
) -> FieldPlan:
    """Add what the robot's own tool leaves out to the warnings of its plan."""
    gaps = describe_gaps(plan.legs, area, request, robot)
    return msgspec.structs.replace(plan, warnings=(*plan.warnings, *gaps))


def describe_gaps(
    legs: tuple[Leg, ...], area: FieldArea, request: PlanRequest, robot: RobotSpec
) -> tuple[str, ...]:
    """Describe what the robot's own tool leaves out in one sentence, or in none."""
    wanted_m, gap_m2 = request.implement_width_m, measure_gaps_m2(legs, area, request, robot)
    if robot.implement is None or gap_m2 == 0.0:
        return ()
    own_m = robot.implement.width_m
    return (
        f"{gap_m2:.1f} m2 between the passes stay unworked: they are laid for a tool of "
        f"{wanted_m:.2f} m, and that of {robot.name} works {own_m:.2f} m; plan with "
        f"{own_m:.2f} m, or mount the wider tool",
    )


def measure_gaps_m2(
    legs: tuple[Leg, ...], area: FieldArea, request: PlanRequest, robot: RobotSpec
) -> float:
    """Measure what passes of the requested width cover and the robot's own tool does not."""
    import shapely

    implement = robot.implement
    if implement is None or implement.width_m > request.implement_width_m - SAME_WIDTH_M:
        return 0.0
    field = shapely.Polygon(area.boundary, area.holes)
    own = msgspec.structs.replace(request, implement_width_m=implement.width_m)
    wide, narrow = (find_covered(legs, field, each)[0].area for each in (request, own))
    return float(wide - narrow)
