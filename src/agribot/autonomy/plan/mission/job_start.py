"""Where a job begins: at the first of its path, or where an earlier mission was cut off."""

from __future__ import annotations

import msgspec

from agribot.autonomy.plan.mission.covered import CoveredRows
from agribot.autonomy.plan.mission.job import MissionJob
from agribot.autonomy.plan.mission.row_log import RowResult
from agribot.autonomy.plan.mission.saved_mission import (
    SavedMission,
    check_not_carried_away,
    check_same_task,
    name_task,
    take_pose,
)
from agribot.autonomy.plan.mission.task import Task
from agribot.autonomy.plan.ways.reach import check_reach
from agribot.autonomy.plan.ways.rows import list_row_ends
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import AllRowsWorked
from agribot.core.messages import Estimate, MapPoint, MissionState


def plan_job(
    task: Task, config: MissionConfig, estimate: Estimate, saved: SavedMission | None = None
) -> MissionJob:
    """Plan a task from where the robot is; after an interruption go on in the path of then.

    `saved` is a mission that had a path when it was cut off.

    Raises: MissionError: no path, the robot or its work is too far away, or the task is another
        one.
    """
    check_reach(_list_places(task), take_pose(estimate)[:2], config)
    if saved is None or saved.planned_from is None:
        return MissionJob(task, config, task.plan(estimate), take_pose(estimate))
    check_not_carried_away(estimate, saved.pose[:2], config.resume_limit_m)
    x_m, y_m, yaw_rad = saved.planned_from
    check_reach(_list_places(task), (x_m, y_m), config)
    then = msgspec.structs.replace(estimate, x_map_m=x_m, y_map_m=y_m, yaw_map_rad=yaw_rad)
    path = task.plan(then)
    covered, skipped = CoveredRows(task.rows), CoveredRows(task.rows)
    is_same_ground = covered.restore(saved.covered) | skipped.restore(saved.skipped)
    name = name_task([row.index for row in task.rows], tuple(task.waypoints), path)
    if is_same_ground and name != saved.task:
        return _plan_rest(task, config, estimate, covered, skipped.complete)
    job = MissionJob(task, config, path, saved.planned_from, covered, saved.detours)
    check_same_task(saved, name, job.route.progress.length_m)
    job.restore(saved)
    return job


def _list_places(task: Task) -> tuple[MapPoint, ...]:
    """List the places; the robot drives to one of them first."""
    return tuple(task.waypoints) or list_row_ends(task.rows)


def _plan_rest(
    task: Task,
    config: MissionConfig,
    estimate: Estimate,
    covered: CoveredRows,
    skipped: tuple[int, ...],
) -> MissionJob:
    """Plan another path over partly worked rows: it begins where the robot is."""
    done = covered.complete
    left = [row.index for row in task.rows if row.index not in done + skipped]
    if not left:
        raise MissionError(AllRowsWorked())
    path = task.plan_rest(estimate, left)
    job = MissionJob(task, config, path, take_pose(estimate), covered)
    job.leave_out(done, skipped)
    return job


def save_unbegun(task: Task, state: MissionState, last: Estimate) -> SavedMission:
    """Save a task that has no path yet: what is kept is where the robot was sent meanwhile."""
    return SavedMission(
        task="",
        state=state,
        t_s=last.t_s,
        planned_from=None,
        pose=take_pose(last),
        length_m=0.0,
        s_m=0.0,
        row=-1,
        rows=list_rows(task),
        waypoints_reached=(False,) * len(task.waypoints),
        visit=tuple(task.waypoints) if task.name else (),
        visit_name=task.name,
    )


def list_rows(task: Task) -> tuple[RowResult, ...]:
    """List the rows of a task that has not begun."""
    return tuple(RowResult(index=row.index) for row in task.rows)
