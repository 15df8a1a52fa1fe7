"""What a mission reports, and what it wants of the robot now."""

from __future__ import annotations

from agribot.autonomy.plan.mission.errand import STOPPING
from agribot.autonomy.plan.mission.job import MissionJob
from agribot.autonomy.plan.mission.route import Route
from agribot.autonomy.plan.mission.states import (
    Ended,
    Paused,
    State,
    Stopping,
    find_away,
    name_state,
)
from agribot.autonomy.plan.mission.task import Task
from agribot.core.fact_text import render
from agribot.core.facts import Fact
from agribot.core.messages import Goal, MissionStatus


def find_way(state: State, job: MissionJob | None) -> Route | None:
    """Find the route of the errand while there is one, else that of the job; None before both."""
    if away := find_away(state):
        return away.route
    return job.route if job else None


def describe(
    task: Task,
    job: MissionJob | None,
    state: State,
    refusal: Fact | None,
    *,
    stopped: Fact | None,
    warning: Fact | None,
) -> MissionStatus:
    """Describe a mission; `stopped` is why the latch holds, `warning` what calls it home."""
    held = state.held if isinstance(state, Stopping | Paused) else None
    way = find_way(state, job)
    progress = way.progress if way else None
    reached = job.waypoints_reached if job else (False,) * len(task.waypoints)
    return MissionStatus(
        state=name_state(state),
        reason=render(state.reason),
        row=job.rows.here if job and not find_away(state) else -1,
        rows_total=len(task.rows),
        rows_done=job.rows.done if job else (),
        s_m=progress.s_m if progress else 0.0,
        length_m=progress.length_m if progress else 0.0,
        waypoints_total=len(reached),
        waypoints_reached=sum(reached),
        leg=_name_leg(state, job),
        distance_left_m=progress.length_m - progress.s_m if progress else 0.0,
        eta_s=way.time_left_s if way else None,
        refusal=render(refusal),
        task=task.name,
        goal_map_m=way.goal if way else None,
        rows_unproven=job.rows.unproven if job else (),
        row_nudged_m=job.rows.nudged_m(job.rows.here) if job and not find_away(state) else 0.0,
        stopped=render(stopped),
        held=render(held),
        warning=render(warning),
        fact=state.reason,
        refusal_fact=refusal,
        stopped_fact=stopped,
        held_fact=held,
        warning_fact=warning,
    )


def _name_leg(state: State, job: MissionJob | None) -> str:
    if isinstance(state, Ended):
        return ""
    if isinstance(state, Stopping):
        return STOPPING
    if away := find_away(state):
        return away.errand.leg
    return job.leg if job else ""


def make_goal(
    way: Route | None,
    task: Task,
    job: MissionJob | None,
    status: MissionStatus,
    caution_ratio: float,
    *,
    is_driving: bool,
    frees_itself: bool,
) -> Goal:
    """Go along the way, slower by the caution; only rows that are still wanted get the tool."""
    if way is None:
        return Goal(path=None, s_m=0.0, max_speed_mps=0.0, tool_on=False, status=status)
    tool_on = is_driving and job is not None and job.is_wanted(way.tool_row)
    return Goal(
        path=way.path,
        s_m=status.s_m,
        max_speed_mps=caution_ratio * way.max_speed_mps if is_driving else 0.0,
        tool_on=tool_on,
        status=status,
        tracked_x_m=task.tool.tracked_x_m if tool_on else 0.0,
        frees_itself=frees_itself,
        bounds=task.bounds,
    )
