"""The task of a mission, chosen by the settings, and the tasks that come in under way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as FilePath

from agribot.app.field_work import read_work
from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.mission.errand import CHECKING
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.tasks.explore_task import ExploreTask
from agribot.autonomy.plan.tasks.field_task import CHECKING_S, FieldTask
from agribot.autonomy.plan.tasks.row_task import RowTask
from agribot.autonomy.plan.tasks.visit_task import VisitTask
from agribot.autonomy.plan.tasks.waypoint_task import WaypointTask
from agribot.autonomy.plan.ways.waypoints import parse_waypoints
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import FileUnreadable, WaypointOffField
from agribot.core.field_bounds import FieldBounds
from agribot.core.geo import MapFrame
from agribot.core.messages import MapPoint, TakePlan, TickRecord
from agribot.core.robot import RobotSpec
from agribot.core.table_text import read_text_file


def choose_task(
    config: RunConfig,
    robot: RobotSpec,
    waypoints_map_m: Sequence[MapPoint] = (),
    work: FieldWork | None = None,
) -> Task:
    """Take the rows of the field, or what stands in for them: waypoints or the work of a plan."""
    if work is not None:
        return FieldTask(work, robot.drive)
    if waypoints_map_m:
        return WaypointTask(waypoints_map_m, config, robot)
    if config.task == "explore":
        return ExploreTask(config, robot)
    return RowTask(config, robot)


class TasksUnderWay:
    """Tasks that may replace the running one: a field plan, or places among the same crop rows."""

    checking_s = CHECKING_S

    def __init__(self, task: Task, config: RunConfig, robot: RobotSpec) -> None:
        self._config, self._robot = config, robot
        self._crop = task.rows if task.has_crop else ()

    def read_plan(self, text: str) -> Task:
        """Read a field plan. Raises: MissionError: it is not a plan, or must not be driven."""
        work = read_work(text, "the plan", self._config, self._robot)
        return FieldTask(work, self._robot.drive, text)

    def visit(self, places: Sequence[MapPoint], name: str, bounds: FieldBounds | None) -> Task:
        """Visit places, (x_map_m, y_map_m) each, off the crop of the task before."""
        return VisitTask(places, name, bounds, self._crop, self._config, self._robot)


class TakenPlans:
    """Says from record to record of a run which field plan the mission works."""

    def __init__(self) -> None:
        self._sent = ""

    def find(self, record: TickRecord) -> str:
        """Find the text of the plan that was taken in this tick; empty where none was."""
        requests = [event.request for event in record.batch.requests]
        sent = [plan.geojson for plan in requests if isinstance(plan, TakePlan)]
        text = self._sent = sent[-1] if sent else self._sent
        if not text or record.status.leg == CHECKING:
            return ""
        self._sent = ""
        return "" if record.status.refusal else text


def read_goals(config: RunConfig) -> tuple[MapPoint, ...]:
    """Read the waypoints of the settings in the map; none where the rows are the task.

    Raises: MissionError: the file is missing or broken, or a waypoint is too far from the field.
    """
    if not config.waypoints:
        return ()
    path = FilePath(config.waypoints)
    try:
        text = read_text_file(path)
    except (OSError, ValueError) as error:
        raise MissionError(FileUnreadable(str(path), str(error))) from error
    frame = MapFrame(config.field.datum)
    limit_m = config.mission.max_waypoint_distance_m
    goals: list[MapPoint] = []
    for number, (lat_deg, lon_deg) in enumerate(parse_waypoints(text, path.name), start=1):
        east_m, north_m, _ = frame.map_from_geodetic(lat_deg, lon_deg, config.field.datum.alt_m)
        distance_m = math.hypot(east_m, north_m)
        if distance_m > limit_m:
            raise MissionError(WaypointOffField(path.name, number, distance_m, limit_m))
        goals.append((east_m, north_m))
    return tuple(goals)
