"""A field plan on its way into a run: made or read, and certified again."""

from __future__ import annotations

import json
from pathlib import Path

from agribot.app.keep_out import settle_keep_out
from agribot.autonomy.plan.coverage.area import PlanRequest
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.coverage.plan_certificate import Certificate, certify_plan
from agribot.autonomy.plan.coverage.planner import plan_field
from agribot.autonomy.plan.coverage.tool_gaps import warn_of_gaps
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import FileUnreadable, ImplementMissing, PlanBroken, PlanUnfit
from agribot.core.robot import RobotSpec
from agribot.core.table_text import read_text_file
from agribot.gis.field_file import read_field
from agribot.gis.keep_out_ground import cut_keep_out
from agribot.gis.plan_file import SavedPlan, parse_plan


def read_plan_text(config: RunConfig) -> str:
    """Read the plan of the settings as it stands in its file; empty where a run has none."""
    if not config.plan:
        return ""
    try:
        return read_text_file(Path(config.plan))
    except (OSError, ValueError) as error:
        raise MissionError(FileUnreadable(config.plan, str(error))) from error


def read_field_work(text: str, config: RunConfig, robot: RobotSpec) -> FieldWork | None:
    """Read the plan of the settings; None without one.

    Raises: MissionError: as `read_work`.
    """
    return read_work(text, Path(config.plan).name, config, robot) if text else None


def read_work(text: str, name: str, config: RunConfig, robot: RobotSpec) -> FieldWork:
    """Read a plan in the map of the run, for this robot.

    Raises: MissionError: not a plan, or the check refuses it for this robot, and where.
    """
    try:
        root = json.loads(text)
    except (ValueError, RecursionError) as error:  # also a number of thousands of digits
        raise MissionError(PlanBroken(name, str(error))) from error
    saved = parse_plan(root, name, config.field.datum)
    saved = saved._replace(area=cut_keep_out(saved.area, config.field.keep_out_map_m))
    shape = measure_footprint(robot, saved.request.implement_width_m, saved.request.tool_x_m)
    certificate = certify_plan(saved.plan, saved.area, shape, saved.request)
    if not certificate.ok:
        problem = certificate.problems[0]
        raise MissionError(PlanUnfit(name, robot.name, problem.rule, problem.fact))
    return FieldWork(saved.plan, saved.area, shape, saved.request)


def choose_width_m(asked_m: float | None, robot: RobotSpec) -> float:
    """Take the width that is asked for, or that of the robot's own implement.

    Raises: MissionError: the robot has none.
    """
    if asked_m is not None:
        return asked_m
    if robot.implement is None:
        raise MissionError(ImplementMissing(robot.name))
    return robot.implement.width_m


def plan_field_file(
    field: Path,
    config: RunConfig,
    robot: RobotSpec,
    width_m: float | None,
    margin_m: float | None = None,
) -> tuple[SavedPlan, Certificate]:
    """Plan a field in the map of a run, beginning where the robot is put down.

    Without a width, it is that of the robot's own implement. `margin_m` is from the footprint to
    every edge, the more, the worse the position is known; None: as the field's file says.
    """
    width_m = choose_width_m(width_m, robot)
    area, datum = read_field(field, config.field.datum)
    area = cut_keep_out(area, settle_keep_out(config).field.keep_out_map_m)
    request = PlanRequest(
        implement_width_m=width_m,
        tool_x_m=robot.tool_x_m,
        margin_m=area.choose_margin_m(margin_m),
    )
    shape = measure_footprint(robot, width_m)
    plan = warn_of_gaps(plan_field(area, shape, request), area, request, robot)
    return SavedPlan(plan, area, request, datum), certify_plan(plan, area, shape, request)
