"""Waypoints of the settings as a task."""

from __future__ import annotations

from collections.abc import Sequence

from agribot.autonomy.plan.mission.route import Tool
from agribot.autonomy.plan.mission.saved_mission import PoseTuple, take_pose
from agribot.autonomy.plan.tasks.row_task import row_clearance_m
from agribot.autonomy.plan.tasks.surroundings import Surroundings
from agribot.autonomy.plan.ways.curves import Place
from agribot.autonomy.plan.ways.waypoints import plan_waypoints
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import NoRowsThere
from agribot.core.messages import Estimate, FloatArray, MapPoint, Path, Row
from agribot.core.robot import RobotSpec


class WaypointTask:
    """Visit places in their order, on ground without crop."""

    rows: tuple[Row, ...] = ()
    has_crop = has_ways = True
    bounds = work = explorer = None
    text = name = ""
    planning_s = errand_planning_s = 0.0

    def __init__(
        self, waypoints_map_m: Sequence[MapPoint], config: RunConfig, robot: RobotSpec
    ) -> None:
        self.waypoints = tuple(waypoints_map_m)
        self.tool = Tool(x_m=robot.tool_x_m)
        self.clearance_m = row_clearance_m(config.field, robot)
        self._mission, self._robot = config.mission, robot
        self._around = Surroundings((), config, robot)

    def plan(self, here: Estimate) -> Path:
        return self._plan_through(self.waypoints, here)

    def plan_rest(self, here: Estimate, indices: Sequence[int]) -> Path:
        return self.plan(here)

    def plan_around(self, path: Path, index: int, skipped: int) -> Path:
        raise MissionError(NoRowsThere())

    def plan_home(self, here: Estimate, home: PoseTuple, row_ahead: FloatArray) -> Path:
        return self._plan_through((home[:2],), here)

    def plan_to(self, here: Estimate, goal: Place) -> Path:
        return self._around.plan_to(here, goal, self.waypoints)

    def plan_back(self, here: Estimate, place: Place) -> Path:
        return self.plan_to(here, place)

    def _plan_through(self, places: Sequence[MapPoint], here: Estimate) -> Path:
        path = plan_waypoints(places, take_pose(here), self._robot, self._mission)
        return self._around.check(path)
