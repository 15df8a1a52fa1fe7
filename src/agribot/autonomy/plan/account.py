"""What a mission tells of itself, and what it wants now."""

from __future__ import annotations

from agribot.autonomy.plan.errand import Errands
from agribot.autonomy.plan.job import Job
from agribot.autonomy.plan.route import Route
from agribot.core.messages import Goal, MissionState, MissionStatus, RequestAnswer

FINAL: tuple[MissionState, ...] = ("done", "cancelled", "failed")


def account(
    job: Job,
    errands: Errands,
    state: MissionState,
    reason: str,
    refusal: str,
    *,
    stopped: str,
    held: str,
    warning: str,
    answers: tuple[RequestAnswer, ...],
) -> MissionStatus:
    way, rows, reached = errands.route or job.route, job.rows, job.waypoints_reached
    progress = way.progress if way else None
    return MissionStatus(
        state=state,
        reason=reason,
        row=-1 if errands.route else rows.here,
        rows_total=len(rows.indices),
        rows_done=rows.done,
        s_m=progress.s_m if progress else 0.0,
        length_m=progress.length_m if progress else 0.0,
        waypoints_total=len(reached),
        waypoints_reached=sum(reached),
        leg="" if state in FINAL else errands.leg or job.leg,
        distance_left_m=progress.length_m - progress.s_m if progress else 0.0,
        eta_s=way.time_left_s if way else None,
        refusal=refusal,
        task=job.task.name,
        goal_map_m=way.goal if way else None,
        rows_unproven=rows.unproven,
        stopped=stopped,
        held=held,
        warning=warning,
        answers=answers,
    )


def wish(
    way: Route | None, job: Job, status: MissionStatus, caution_ratio: float, *, is_driving: bool
) -> Goal:
    """Along the way, slower by the caution; only rows that are still wanted get the tool."""
    if way is None:
        return Goal(path=None, s_m=0.0, max_speed_mps=0.0, tool_on=False, status=status)
    tool_on = is_driving and job.is_wanted(way.tool_row)
    return Goal(
        path=way.path,
        s_m=status.s_m,
        max_speed_mps=caution_ratio * way.max_speed_mps if is_driving else 0.0,
        tool_on=tool_on,
        status=status,
        tracked_x_m=job.task.tool.tracked_x_m if tool_on else 0.0,
        bounds=job.task.bounds,
    )
