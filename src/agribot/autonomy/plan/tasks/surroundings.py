"""What every way of a task over open rows keeps off, and the fence that it stays in."""

from __future__ import annotations

from collections.abc import Sequence

from agribot.autonomy.plan.mission.saved_mission import take_pose
from agribot.autonomy.plan.ways.certify import certify
from agribot.autonomy.plan.ways.curves import Place
from agribot.autonomy.plan.ways.goal_way import make_fence, plan_to_place
from agribot.autonomy.plan.ways.obstacles import make_obstacles
from agribot.core.config import RunConfig
from agribot.core.messages import Estimate, MapPoint, Path, Row
from agribot.core.robot import RobotSpec


class Surroundings:
    """Crop rows, and what stands in the field."""

    def __init__(self, crop: Sequence[Row], config: RunConfig, robot: RobotSpec) -> None:
        self._crop, self._robot = crop, robot
        self._mission = config.mission
        self._margin_m = config.safety.geofence_margin_m
        clearance_m = config.mission.obstacle_clearance_m
        self.obstacles = make_obstacles(
            config.field.obstacles_map_m, clearance_m, robot, config.field.keep_out_map_m
        )

    def check(self, path: Path) -> Path:
        """Give back a path that is clear. Raises: MissionError: what it comes too close to."""
        if self._crop:
            certify(path, self._crop, self._robot, self._mission.plant_clearance_m)
        self.obstacles.check(path)
        return path

    def plan_to(self, here: Estimate, goal: Place, places: Sequence[MapPoint]) -> Path:
        """Plan inside a fence around the robot and `places`, as wide as the supervisor's."""
        pose = take_pose(here)
        fence = make_fence([*places, pose[:2]], self._margin_m)
        return plan_to_place(
            goal, pose, self._crop, fence, self._robot, self._mission, self.obstacles
        )
