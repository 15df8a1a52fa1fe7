"""An unmapped field as a task: its rows are found while they are driven."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.plan.explore.explorer import Explorer
from agribot.autonomy.plan.mission.route import Tool
from agribot.autonomy.plan.mission.saved_mission import PoseTuple, take_pose
from agribot.autonomy.plan.tasks.surroundings import Surroundings
from agribot.autonomy.plan.ways.boustrophedon import plan_home
from agribot.autonomy.plan.ways.curves import Place
from agribot.autonomy.plan.ways.rows import list_row_ends
from agribot.autonomy.plan.ways.waypoints import plan_waypoints
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import RowsAsFound
from agribot.core.messages import Estimate, FloatArray, MapPoint, Path, Row
from agribot.core.pose import Pose2
from agribot.core.robot import RobotSpec


class ExploreTask:
    """Find the rows by camera and drive over each of them once, by its sight alone.

    Where the robot is in the map does not steer it in a row, so that nothing here slows it down
    that doubts the map: what the camera does not show is not driven.
    """

    waypoints: tuple[MapPoint, ...] = ()
    has_crop, has_ways = False, True
    clearance_m = math.inf
    bounds = work = None
    text = name = ""
    planning_s = errand_planning_s = 0.0

    def __init__(self, config: RunConfig, robot: RobotSpec) -> None:
        self.tool = Tool(x_m=robot.tool_x_m)
        self._config, self._robot = config, robot
        self.explorer = Explorer(config.mission, robot)

    @property
    def rows(self) -> tuple[Row, ...]:
        return self.explorer.rows

    def plan(self, here: Estimate) -> Path:
        self.explorer = Explorer(self._config.mission, self._robot)
        return self.explorer.begin(Pose2(*take_pose(here)))

    def plan_rest(self, here: Estimate, indices: Sequence[int]) -> Path:
        return self.plan(here)

    def plan_around(self, path: Path, index: int, skipped: int) -> Path:
        raise MissionError(RowsAsFound())

    def plan_home(self, here: Estimate, home: PoseTuple, row_ahead: FloatArray) -> Path:
        mission = self._config.mission
        if not self.rows:
            return plan_waypoints((home[:2],), take_pose(here), self._robot, mission)
        return plan_home(self.rows, take_pose(here), home, self._robot, mission)

    def plan_to(self, here: Estimate, goal: Place) -> Path:
        around = Surroundings(self.rows, self._config, self._robot)
        return around.plan_to(here, goal, list_row_ends(self.rows))

    def plan_back(self, here: Estimate, place: Place) -> Path:
        return self.plan_to(here, place)
