"""What speaks for having driven this very row, and not the one beside it or bare ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from agribot.autonomy.plan.mission.caution import across_std_m
from agribot.autonomy.plan.mission.row_log import Doubt
from agribot.autonomy.plan.mission.task import Task
from agribot.core.messages import Estimate, GnssQuality, Row
from agribot.core.row_shape import project_on_row

# A position known across the rows to this share of their distance (1 sigma) identifies the row.
DISTINCT_ROWS_RATIO = 0.25
# Gap between straight stretches of one row. A bent row of a plan is worked in straight stretches,
# each beginning at the end of the last one.
SAME_ROW_M = 0.05


def row_pitch_m(rows: Sequence[Row]) -> float:
    """Measure the least distance between neighbouring rows; infinite for a lone one."""
    gaps_m = [
        abs(float(project_on_row(row, *following.start_map_m).left_m))
        for row, following in pairwise(rows)
    ]
    return min((gap_m for gap_m in gaps_m if gap_m > SAME_ROW_M), default=math.inf)


def link_stretches(rows: Sequence[Row]) -> dict[int, int]:
    """Find the stretches of bent rows: the number of each and of the one that goes on behind it."""
    return {
        row.index: following.index
        for row, following in pairwise(rows)
        if math.dist(row.end_map_m, following.start_map_m) < SAME_ROW_M
    }


def find_doubt(task: Task, estimate: Estimate, row_yaw_rad: float, pitch_m: float) -> Doubt:
    """Say why the robot may not be in the row of a task; empty where it has good reason to.

    Where a camera looks, it has to see the crop of the row; without one, or without crop, the
    position has to be known well enough. A swath without crop is where the position says.
    """
    if not task.has_crop and (task.work is not None or task.explorer is not None):
        return ""
    if task.has_crop and estimate.row_seen is not None:
        return "" if estimate.row_seen else "unseen"
    is_sure = across_std_m(estimate, row_yaw_rad) <= DISTINCT_ROWS_RATIO * pitch_m
    return "" if is_sure else "unsure"


def is_counted(task: Task, estimate: Estimate) -> bool:
    """Return whether only the rows before identify this row.

    Rows look alike to a camera, and without fixed ambiguities the position goes back to the start
    mark: a robot that was put down one row off it is one row off everywhere.
    """
    return task.has_crop and estimate.quality is not GnssQuality.RTK_FIXED
