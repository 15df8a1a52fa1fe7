"""A field plan as a task."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.autonomy.plan.coverage.drive import FieldWork
from agribot.autonomy.plan.mission.caution import protection_limit_m
from agribot.autonomy.plan.mission.route import Tool
from agribot.autonomy.plan.mission.saved_mission import PoseTuple, take_pose
from agribot.autonomy.plan.ways.curves import Place
from agribot.core.errors import MissionError
from agribot.core.facts import RowsAsPlanned
from agribot.core.messages import Estimate, FloatArray, MapPoint, Path
from agribot.core.robot import DriveSpec

# Room for work off the control loop on a slow machine with a busy core: a field plan and its
# check, a way within its field, and its path (0.4 s of one core for 10 km, measured).
CHECKING_S = 0.5
PLANNED_MPS = 5000.0


class FieldTask:
    """Drive a plan in its own order, as rows of its straight stretches."""

    waypoints: tuple[MapPoint, ...] = ()
    has_ways = True
    explorer = None
    name = ""
    errand_planning_s = CHECKING_S

    def __init__(self, work: FieldWork, drive: DriveSpec, text: str = "") -> None:
        self.work, self.text = work, text
        self.rows, self.bounds, self.has_crop = work.rows, work.bounds, work.has_crop
        tracked_x_m = 0.0 if work.has_crop else work.request.tool_x_m
        self.tool = Tool(reach_m=0.0, tracked_x_m=tracked_x_m)
        self.clearance_m = protection_limit_m(drive) if work.has_crop else math.inf
        self.planning_s = CHECKING_S + work.length_m / PLANNED_MPS

    def plan(self, here: Estimate) -> Path:
        return self.work.plan_from(take_pose(here))

    def plan_rest(self, here: Estimate, indices: Sequence[int]) -> Path:
        return self.plan(here)

    def plan_around(self, path: Path, index: int, skipped: int) -> Path:
        raise MissionError(RowsAsPlanned())

    def plan_home(self, here: Estimate, home: PoseTuple, row_ahead: FloatArray) -> Path:
        return self.work.plan_home(take_pose(here)[:2], home[:2], row_ahead)

    def plan_to(self, here: Estimate, goal: Place) -> Path:
        return self.work.plan_to(take_pose(here)[:2], goal)

    def plan_back(self, here: Estimate, place: Place) -> Path:
        return self.work.plan_back(take_pose(here)[:2], place)
