"""Rows of crop that stand in or beside a field and are not worked: no wheel and no tool on them."""

from __future__ import annotations

import msgspec

from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.coverage.plan_certificate import certify_plan
from agribot.core.facts import WayCrossesCrop
from tests.autonomy.plan.fields import REQUEST, ROW_REQUEST, ROWS, SHAPE, SQUARE, certified
from tests.finding import refused

CROP = (((6.0, 5.0), (14.0, 5.0)), ((6.0, 6.0), (14.0, 6.0)))
AMONG_CROP = msgspec.structs.replace(SQUARE, crop=CROP)


def test_swaths_are_laid_around_crop_that_stands_there() -> None:
    _, certificate = certified(AMONG_CROP)
    assert certificate.ok, certificate.problems
    assert certificate.wheel_row_clearance_m is not None
    assert certificate.wheel_row_clearance_m >= REQUEST.plant_clearance_m
    _, without = certified(SQUARE)
    assert certificate.covered_area_m2 < without.covered_area_m2 - 8.0 * 1.0


def test_a_plan_over_crop_is_refused_for_its_wheels_and_its_tool() -> None:
    plan, _ = certified(SQUARE)
    certificate = certify_plan(plan, AMONG_CROP, SHAPE, REQUEST)
    assert {problem.rule for problem in certificate.problems} == {"wheels", "crop"}


def test_rows_beside_those_that_are_worked_are_kept_off() -> None:
    worked = msgspec.structs.replace(ROWS, rows=ROWS.rows[:3], crop=ROWS.rows[3:])
    plan, certificate = certified(worked, ROW_REQUEST)
    assert certificate.ok, certificate.problems
    assert sum(leg.tool_on for leg in plan.legs) == 3


def test_no_way_into_a_field_crosses_crop_that_stands_beside_it() -> None:
    beside = msgspec.structs.replace(SQUARE, crop=(((-3.0, -5.0), (-3.0, 20.0)),))
    plan, certificate = certified(beside)
    assert certificate.ok, certificate.problems
    work = FieldWork(plan, beside, SHAPE, REQUEST)
    work.plan_from((-1.0, 7.0, 0.0))
    with refused(WayCrossesCrop):
        work.plan_from((-9.0, 7.0, 0.0))
    with refused(WayCrossesCrop):
        work.plan_home((5.0, 7.0), (-9.0, 7.0), plan.legs[0].xy_map_m[:0])
