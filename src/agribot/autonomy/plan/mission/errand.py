"""A drive beside the work: home, to a place, back to the work, out of a lost row, off a clod."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from agribot.autonomy.plan.mission.errand_kind import ErrandKind
from agribot.autonomy.plan.mission.job import MissionJob
from agribot.autonomy.plan.mission.route import Route
from agribot.autonomy.plan.mission.saved_mission import SavedErrand, take_pose
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.ways.curves import Place, make_path
from agribot.autonomy.plan.ways.freeing import Trail
from agribot.autonomy.plan.ways.reach import check_reach
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import GoalNotFinite, NothingPlanned, OwnPathOnly, ThereAlready
from agribot.core.messages import Estimate, MapPoint, Path
from agribot.core.pose import Pose2

STANDING_MPS = 0.02
# Shown as who asked for an errand for which no person did.
BATTERY, LOST, STUCK, MISSION = "the battery", "the lost row", "the ground", "the mission"
CHECKING = "checks the plan"  # the leg while a field plan is judged
STOPPING = "stops first"  # the leg until the robot stands and its errand is planned


class Errand(NamedTuple):
    """A drive beside the work: its purpose, who asked for it, and its plan from the robot's place.

    `asked_by` is shown to people and decides nothing.
    """

    kind: ErrandKind
    asked_by: str
    plan: Callable[[Estimate], Path]
    goal: tuple[float, ...] = ()
    place: MapPoint | None = None  # end of the path; None if it begins at the robot's own track

    @property
    def leg(self) -> str:
        return self.kind.leg

    @property
    def refusal(self) -> str:
        return self.kind.refusal

    def plan_route(self, estimate: Estimate, config: MissionConfig) -> Route:
        """Plan it from here. Raises: MissionError: there is no way that may be driven."""
        places = () if self.place is None else (self.place,)
        check_reach(places, take_pose(estimate)[:2], config)
        return Route(self.plan(estimate), (), config, ())


def save_errand(errand: Errand | None) -> SavedErrand | None:
    if errand is None:
        return None
    return SavedErrand(to=errand.kind, source=errand.asked_by, goal=errand.goal)


def make_home_errand(
    task: Task,
    job: MissionJob | None,
    asked_by: str,
    kind: Literal[ErrandKind.HOME, ErrandKind.CHARGE] = ErrandKind.HOME,
) -> Errand:
    """Send the robot to where its job was planned.

    Raises: MissionError: nothing was planned yet, or a task that knows no ways.
    """
    if job is None:
        raise MissionError(NothingPlanned())
    _check_ways(task)
    ahead = job.route.row_ahead if task.has_crop else job.route.path.xy_map_m[:0]
    home = job.planned_from
    return Errand(kind, asked_by, lambda here: task.plan_home(here, home, ahead), (), home[:2])


def make_goal_errand(task: Task, asked_by: str, numbers: tuple[float, ...]) -> Errand:
    """Send the robot to x and y (m, map) and, where it matters, to look along a yaw (rad).

    Raises: MissionError: no place, or a task that knows no ways.
    """
    if len(numbers) not in (2, 3) or not all(math.isfinite(number) for number in numbers):
        raise MissionError(GoalNotFinite())
    goal: Place = (numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else None)
    _check_ways(task)
    return Errand(
        ErrandKind.GOAL, asked_by, lambda here: task.plan_to(here, goal), numbers, goal[:2]
    )


def make_work_errand(task: Task, job: MissionJob | None) -> Errand:
    """Send the robot back to where its work stopped.

    Raises: MissionError: nothing was planned yet, or a task that knows no ways.
    """
    if job is None:
        raise MissionError(NothingPlanned())
    _check_ways(task)
    place = job.place_to_go_on
    return Errand(ErrandKind.WORK, MISSION, lambda here: task.plan_back(here, place), (), place[:2])


def make_back_errand(
    job: MissionJob, kind: Literal[ErrandKind.BACK, ErrandKind.OUT], s_m: float
) -> Errand:
    """Let the robot back out of its row, straight on its track, to a distance along its route."""
    return Errand(
        kind, LOST, lambda here: _plan_back_out(job.route, take_pose(here)[:2], s_m), (s_m,)
    )


def make_free_errand(trail: Trail, back_m: float) -> Errand:
    """Let the robot back out of a place where it is stuck, on the bend on which it came."""
    return Errand(
        ErrandKind.FREE, STUCK, lambda here: trail.plan_back(Pose2(*take_pose(here)), back_m)
    )


def _plan_back_out(route: Route, place: MapPoint, s_m: float) -> Path:
    """Plan the route backwards, moved aside to where the robot is.

    Raises: MissionError: it is there already.
    """
    path, last = route.path, route.progress.index
    first = int(np.searchsorted(path.s_m, s_m))
    if last - first < 2:
        raise MissionError(ThereAlready())
    way = slice(first, last + 1)
    table = np.zeros((last + 1 - first, 6))
    aside = np.array(place) - path.xy_map_m[last]
    table[:, :2] = path.xy_map_m[way][::-1] + aside
    table[:, 2] = path.yaw_map_rad[way][::-1]
    table[:, 3] = -path.curvature_radpm[way][::-1]
    table[:, 4] = -1
    table[:, 5] = path.s_m[last] - path.s_m[way][::-1]
    return make_path(table)


def restore_errand(saved: SavedErrand, task: Task, job: MissionJob | None) -> Errand:
    """Send the robot once more where an earlier run was to go.

    Raises: MissionError: as those that make it.
    """
    match saved.to:
        case ErrandKind.HOME | ErrandKind.CHARGE as kind:
            return make_home_errand(task, job, saved.source, kind)
        case ErrandKind.GOAL:
            return make_goal_errand(task, saved.source, saved.goal)
        case _:
            return make_work_errand(task, job)


def _check_ways(task: Task) -> None:
    if not task.has_ways:
        raise MissionError(OwnPathOnly())
