"""The task of a mission, made of the settings or of a field plan: no path without its check."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath

from agribot.app.field_work import work_from
from agribot.autonomy.plan.boustrophedon import plan_home, plan_rows, plan_without
from agribot.autonomy.plan.caution import protection_limit_m
from agribot.autonomy.plan.certify import certify
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.curves import Place
from agribot.autonomy.plan.errand import CHECKING
from agribot.autonomy.plan.goal_way import fence_around, plan_to_place
from agribot.autonomy.plan.obstacles import Obstacles, obstacles_for
from agribot.autonomy.plan.route import Tool
from agribot.autonomy.plan.rows import field_rows
from agribot.autonomy.plan.saved_mission import PoseTuple
from agribot.autonomy.plan.task import NewTasks, Task
from agribot.autonomy.plan.waypoints import parse_waypoints, plan_waypoints
from agribot.core.config import MissionConfig, RunConfig
from agribot.core.errors import MissionError
from agribot.core.geo import MapFrame
from agribot.core.messages import Estimate, FloatArray, MapPoint, Path, Row, TickRecord
from agribot.core.robot import RobotSpec

# Room for work off the control loop on a slow machine with a busy core: a field plan and its
# check, a way within its field, and its path (0.4 s of one core for 10 km, measured).
CHECKING_S = 0.5
PLANNED_MPS = 5000.0


def task_of(
    config: RunConfig,
    robot: RobotSpec,
    waypoints_map_m: tuple[MapPoint, ...] = (),
    work: FieldWork | None = None,
) -> Task:
    """The rows of the field, or what stands in for them: waypoints or the work of a plan."""
    if work is not None:
        return _work_task(work, robot)
    rows = () if waypoints_map_m else field_rows(config.field)
    mission, obstacles = config.mission, _obstacles(config, robot)
    check = _checks(rows, robot, mission, obstacles)

    def plan(estimate: Estimate) -> Path:
        if waypoints_map_m:
            return check(plan_waypoints(waypoints_map_m, _pose(estimate), robot, mission))
        return check(plan_rows(rows, _pose(estimate), robot, mission, (), obstacles))

    def go_home(estimate: Estimate, home: PoseTuple, _: FloatArray) -> Path:
        if not rows:
            return check(plan_waypoints((home[:2],), _pose(estimate), robot, mission))
        return check(plan_home(rows, _pose(estimate), home, robot, mission, obstacles))

    def around(path: Path, index: int, skipped: int) -> Path:
        return check(plan_without(path, index, skipped, rows, robot, mission, obstacles))

    def rest(estimate: Estimate, indices: Sequence[int]) -> Path:
        left = [row for row in rows if row.index in indices]
        return check(plan_rows(left, _pose(estimate), robot, mission, rows, obstacles))

    go_to = _place_planner(config, robot, rows, waypoints_map_m, obstacles)
    tool = Tool(x_m=robot.tool_x_m)
    return Task(
        plan, rows, waypoints_map_m, tool, home=go_home, go_to=go_to, back=go_to, around=around,
        rest=None if waypoints_map_m else rest, clearance_m=_clearance_m(config, robot),
    )  # fmt: skip


def tasks_under_way(task: Task, config: RunConfig, robot: RobotSpec) -> NewTasks:
    """What may take the place of a task: a field plan, or places among the same crop rows."""
    rows = task.rows if task.has_crop else ()
    check = _checks(rows, robot, config.mission, _obstacles(config, robot))

    def of_plan(text: str) -> Task:
        taken = work_from(text, "the plan", config, robot)
        return _work_task(taken, robot)._replace(text=text)

    def of_places(places_map_m: Sequence[MapPoint], name: str) -> Task:
        def plan(estimate: Estimate) -> Path:
            return check(plan_waypoints(places_map_m, _pose(estimate), robot, config.mission))

        return Task(plan, waypoints=places_map_m, name=name)

    return NewTasks(of_plan, of_places, CHECKING_S)


class TakenPlans:
    """Tells from record to record of a run which field plan the mission works."""

    def __init__(self) -> None:
        self._sent = ""

    def taken(self, record: TickRecord) -> str:
        """The text of the plan that was taken in this tick; empty where none was."""
        sent = [event.text for event in record.batch.events if event.action == "plan"]
        text = self._sent = sent[-1] if sent else self._sent
        if not text or record.status.leg == CHECKING:
            return ""
        self._sent = ""
        return "" if record.status.refusal else text


def _work_task(work: FieldWork, robot: RobotSpec) -> Task:
    return Task(
        lambda estimate: work.path_from(_pose(estimate)),
        work.rows,
        tool=Tool(reach_m=0.0, tracked_x_m=0.0 if work.has_crop else work.request.tool_x_m),
        has_crop=work.has_crop,
        home=lambda here, home, ahead: work.path_home(_pose(here)[:2], home[:2], ahead),
        go_to=lambda here, goal: work.path_to(_pose(here)[:2], goal),
        back=lambda here, goal: work.path_back(_pose(here)[:2], goal),
        work=work,
        bounds=work.bounds,
        planning_s=CHECKING_S + work.length_m / PLANNED_MPS,
        errand_planning_s=CHECKING_S,
        clearance_m=protection_limit_m(robot.drive) if work.has_crop else math.inf,
    )


def _clearance_m(config: RunConfig, robot: RobotSpec) -> float:
    field = config.field
    return protection_limit_m(robot.drive, field.row_pitch_m if field.row_count > 1 else math.inf)


def _place_planner(
    config: RunConfig,
    robot: RobotSpec,
    rows: tuple[Row, ...],
    waypoints: tuple[MapPoint, ...],
    obstacles: Obstacles,
) -> Callable[[Estimate, Place], Path]:
    """Inside a fence around rows, waypoints and the robot, as wide as the supervisor's."""
    places = [*waypoints, *row_ends(rows)]

    def plan(estimate: Estimate, goal: Place) -> Path:
        pose = _pose(estimate)
        fence = fence_around([*places, pose[:2]], config.safety.geofence_margin_m)
        return plan_to_place(goal, pose, rows, fence, robot, config.mission, obstacles)

    return plan


def _checks(
    rows: Sequence[Row], robot: RobotSpec, mission: MissionConfig, obstacles: Obstacles
) -> Callable[[Path], Path]:
    """Gives back a path that keeps off the crop and off what stands in the field."""

    def check(path: Path) -> Path:
        if rows:
            certify(path, rows, robot, mission.plant_clearance_m)
        obstacles.check(path)
        return path

    return check


def _obstacles(config: RunConfig, robot: RobotSpec) -> Obstacles:
    clearance_m = config.mission.obstacle_clearance_m
    return obstacles_for(config.field.obstacles_map_m, clearance_m, robot)


def _pose(estimate: Estimate) -> PoseTuple:
    return estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad


def read_goals(config: RunConfig) -> tuple[MapPoint, ...]:
    """The waypoints of the settings in the map; none where the rows of the field are the task.

    Raises: MissionError: the file is missing or broken, or a waypoint is too far from the field.
    """
    if not config.waypoints:
        return ()
    path = FilePath(config.waypoints)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MissionError(f"cannot read waypoints from {path}: {error}; check the path") from error
    frame = MapFrame(config.field.datum)
    limit_m = config.mission.max_waypoint_distance_m
    goals: list[MapPoint] = []
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


def row_ends(rows: Sequence[Row]) -> tuple[MapPoint, ...]:
    """Both ends of every row, the goals that a map shows for a mission over rows."""
    return tuple(end for row in rows for end in (row.start_map_m, row.end_map_m))
