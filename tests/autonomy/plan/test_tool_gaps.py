"""The ground that a plan for a wider tool leaves out is reported with its size."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.plan.coverage.area import FieldArea, FieldPlan, Leg, PlanRequest
from agribot.autonomy.plan.coverage.tool_gaps import measure_gaps_m2, warn_of_gaps
from agribot.description.loader import load_robot

ROBOT = load_robot("agribot")
AREA = FieldArea(boundary=((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)))
LEGS = tuple(
    Leg(kind="swath", xy_map_m=np.array([[5.0, y_m], [15.0, y_m]])) for y_m in (5.0, 6.5, 8.0)
)
PLAN = FieldPlan(legs=LEGS, swath_yaw_rad=0.0, warnings=("a corner cannot be reached",))


@pytest.mark.parametrize(("width_m", "gaps_m2"), [(1.08, 0.0), (0.9, 0.0), (1.5, 3 * 10 * 0.42)])
def test_the_gaps_are_what_the_wider_tool_passes_and_the_robots_own_does_not(
    width_m: float, gaps_m2: float
) -> None:
    request = PlanRequest(implement_width_m=width_m)
    assert ROBOT.implement is not None and ROBOT.implement.width_m == pytest.approx(1.08)
    assert measure_gaps_m2(LEGS, AREA, request, ROBOT) == pytest.approx(gaps_m2)
    warnings = warn_of_gaps(PLAN, AREA, request, ROBOT).warnings
    assert warnings[0] == PLAN.warnings[0]
    assert len(warnings) == (2 if gaps_m2 else 1)
    if gaps_m2:
        assert warnings[1].startswith("12.6 m2 between the passes stay unworked")
