"""What a mission tells of itself."""

from __future__ import annotations

from agribot.messages import MissionState, MissionStatus
from agribot.plan.errand import Errands
from agribot.plan.job import Job

FINAL: tuple[MissionState, ...] = ("done", "cancelled", "failed")


def account(
    job: Job, errands: Errands, state: MissionState, reason: str, refusal: str
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
    )
