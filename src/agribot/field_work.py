"""The task of a run on its way in: a field plan, made or read and certified again; waypoints."""

from __future__ import annotations

import json
import math
from pathlib import Path

from agribot.config import RunConfig
from agribot.errors import MissionError
from agribot.geo import MapFrame
from agribot.gis.field_file import read_field
from agribot.gis.plan_file import SavedPlan, plan_from
from agribot.plan.coverage.area import PlanRequest, footprint
from agribot.plan.coverage.drive import FieldWork
from agribot.plan.coverage.planner import plan_field
from agribot.plan.plan_certificate import Certificate, certify_plan
from agribot.plan.waypoints import parse_waypoints
from agribot.robot import RobotSpec


def read_plan_text(config: RunConfig) -> str:
    """The plan of the settings as it stands in its file; empty where a run has none."""
    if not config.plan:
        return ""
    try:
        return Path(config.plan).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MissionError(f"cannot read {config.plan}: {error}; check the path") from error


def field_work(text: str, config: RunConfig, robot: RobotSpec) -> FieldWork | None:
    """The plan in the map of the run, for this robot; None without a plan.

    Raises: MissionError: not a plan, or the check refuses it for this robot, and where.
    """
    if not text:
        return None
    name = Path(config.plan).name
    try:
        root = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise MissionError(f"{name} is not valid JSON: {error}") from error
    saved = plan_from(root, name, config.field.datum)
    shape = footprint(robot, saved.request.implement_width_m, saved.request.tool_x_m)
    certificate = certify_plan(saved.plan, saved.area, shape, saved.request)
    if not certificate.ok:
        problem = certificate.problems[0]
        raise MissionError(f"{name} is refused for {robot.name}: {problem.rule}: {problem.message}")
    return FieldWork(saved.plan, saved.area, shape, saved.request)


def planned(
    field: Path, config: RunConfig, robot: RobotSpec, width_m: float | None
) -> tuple[SavedPlan, Certificate]:
    """Plan a field in the map of a run, beginning where the robot is put down.

    Without a width, the implement is as wide as the boom of the robot.
    """
    if width_m is None:
        if robot.sprayer is None:
            raise MissionError(f"{robot.name} has no implement; give --implement-width M")
        width_m = robot.sprayer.nozzle_count * robot.sprayer.nozzle_spacing_m
    area, datum = read_field(field, config.field.datum)
    request = PlanRequest(implement_width_m=width_m, tool_x_m=robot.tool_x_m)
    shape = footprint(robot, width_m)
    plan = plan_field(area, shape, request)
    return SavedPlan(plan, area, request, datum), certify_plan(plan, area, shape, request)


def read_goals(config: RunConfig) -> tuple[tuple[float, float], ...]:
    """The waypoints of the settings in the map; none where the rows of the field are the task.

    Raises: MissionError: the file is missing or broken, or a waypoint is too far from the field.
    """
    if not config.waypoints:
        return ()
    path = Path(config.waypoints)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MissionError(f"cannot read waypoints from {path}: {error}; check the path") from error
    frame = MapFrame(config.field.datum)
    limit_m = config.mission.max_waypoint_distance_m
    goals: list[tuple[float, float]] = []
    for number, (lat_deg, lon_deg) in enumerate(parse_waypoints(text, path.name), start=1):
        east_m, north_m, _ = frame.map_from_geodetic(lat_deg, lon_deg, config.field.datum.alt_m)
        distance_m = math.hypot(east_m, north_m)
        if distance_m > limit_m:
            raise MissionError(
                f"{path.name}: waypoint {number} is {distance_m:.0f} m from the field's origin, "
                f"farther than {limit_m:.0f} m; correct it, or raise "
                "mission.max_waypoint_distance_m"
            )
        goals.append((east_m, north_m))
    return tuple(goals)
