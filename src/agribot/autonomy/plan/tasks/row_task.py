"""The crop rows of the settings as a task."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.plan.coverage.row_room import check_row_room
from agribot.autonomy.plan.mission.caution import protection_limit_m
from agribot.autonomy.plan.mission.route import Tool
from agribot.autonomy.plan.mission.saved_mission import PoseTuple, take_pose
from agribot.autonomy.plan.tasks.surroundings import Surroundings
from agribot.autonomy.plan.ways.boustrophedon import plan_home, plan_rows, plan_without
from agribot.autonomy.plan.ways.curves import Place
from agribot.autonomy.plan.ways.rows import lay_rows, list_row_ends
from agribot.core.config import FieldConfig, RunConfig
from agribot.core.messages import Estimate, FloatArray, MapPoint, Path
from agribot.core.robot import RobotSpec
from agribot.core.row_shape import row_points_map_m


class RowTask:
    """Drive over every row of the field once, neighbours in alternating direction."""

    waypoints: tuple[MapPoint, ...] = ()
    has_ways = True
    bounds = work = explorer = None
    text = name = ""
    planning_s = errand_planning_s = 0.0

    def __init__(self, config: RunConfig, robot: RobotSpec) -> None:
        """Lay the rows. Raises: MissionError: they are bent too tightly, or too narrow for it."""
        self.rows, self.has_crop = lay_rows(config.field), config.field.has_crop
        self.tool = Tool(x_m=robot.tool_x_m)
        self.clearance_m = row_clearance_m(config.field, robot)
        self._mission, self._robot = config.mission, robot
        self._around = Surroundings(self.rows, config, robot)
        self._ends = list_row_ends(self.rows)
        self._check_room()

    def _check_room(self) -> None:
        lines = [row_points_map_m(row).tolist() for row in self.rows]
        wheels_left_m = self._robot.wheel_xy_body_m()[:, 1].tolist()
        width_m, clear_m = self._robot.drive.wheel_width_m, self._mission.plant_clearance_m
        check_row_room(lines, lines, wheels_left_m, width_m, clear_m, self._robot.name)

    def plan(self, here: Estimate) -> Path:
        obstacles = self._around.obstacles
        path = plan_rows(self.rows, take_pose(here), self._robot, self._mission, (), obstacles)
        return self._around.check(path)

    def plan_rest(self, here: Estimate, indices: Sequence[int]) -> Path:
        left = [row for row in self.rows if row.index in indices]
        obstacles = self._around.obstacles
        path = plan_rows(left, take_pose(here), self._robot, self._mission, self.rows, obstacles)
        return self._around.check(path)

    def plan_around(self, path: Path, index: int, skipped: int) -> Path:
        obstacles = self._around.obstacles
        rest = plan_without(path, index, skipped, self.rows, self._robot, self._mission, obstacles)
        return self._around.check(rest)

    def plan_home(self, here: Estimate, home: PoseTuple, row_ahead: FloatArray) -> Path:
        obstacles = self._around.obstacles
        path = plan_home(self.rows, take_pose(here), home, self._robot, self._mission, obstacles)
        return self._around.check(path)

    def plan_to(self, here: Estimate, goal: Place) -> Path:
        return self._around.plan_to(here, goal, self._ends)

    def plan_back(self, here: Estimate, place: Place) -> Path:
        return self.plan_to(here, place)


def row_clearance_m(field: FieldConfig, robot: RobotSpec) -> float:
    """Measure how far a robot may be off a row of the field before a wheel reaches crop."""
    if not field.has_crop:
        return math.inf
    pitch_m = field.row_pitch_m if field.row_count > 1 else math.inf
    return protection_limit_m(robot.drive, pitch_m)
