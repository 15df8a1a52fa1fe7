"""Places that somebody sends the robot to under way, as a task."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.plan.mission.route import AT_ORIGIN
from agribot.autonomy.plan.mission.saved_mission import PoseTuple, take_pose
from agribot.autonomy.plan.tasks.surroundings import Surroundings
from agribot.autonomy.plan.ways.curves import Place
from agribot.autonomy.plan.ways.waypoints import plan_waypoints
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import VisitPathOnly
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import Estimate, FloatArray, MapPoint, Path, Row
from agribot.core.robot import RobotSpec


class VisitTask:
    """Visit places in their order, off the crop of the task before; it drives no other way."""

    rows: tuple[Row, ...] = ()
    tool = AT_ORIGIN
    has_crop, has_ways = True, False
    clearance_m = math.inf
    work = explorer = None
    text = ""
    planning_s = errand_planning_s = 0.0

    def __init__(
        self,
        places_map_m: Sequence[MapPoint],
        name: str,
        bounds: FieldBounds | None,
        crop: Sequence[Row],
        config: RunConfig,
        robot: RobotSpec,
    ) -> None:
        self.waypoints, self.name, self.bounds = tuple(places_map_m), name, bounds
        self._mission, self._robot = config.mission, robot
        self._around = Surroundings(crop, config, robot)

    def plan(self, here: Estimate) -> Path:
        path = plan_waypoints(self.waypoints, take_pose(here), self._robot, self._mission)
        return self._around.check(path)

    def plan_rest(self, here: Estimate, indices: Sequence[int]) -> Path:
        return self.plan(here)

    def plan_around(self, path: Path, index: int, skipped: int) -> Path:
        raise self._refuse()

    def plan_home(self, here: Estimate, home: PoseTuple, row_ahead: FloatArray) -> Path:
        raise self._refuse()

    def plan_to(self, here: Estimate, goal: Place) -> Path:
        """Plan a way that somebody asks for and that the visit does not drive."""
        return self._around.plan_to(here, goal, self.waypoints)

    def plan_back(self, here: Estimate, place: Place) -> Path:
        raise self._refuse()

    def _refuse(self) -> MissionError:
        return MissionError(VisitPathOnly(self.name))
