"""Whether a robot that straddles a row has room for its wheels beside the next one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agribot.core.errors import MissionError
from agribot.core.facts import RowsTight
from agribot.core.messages import MapPoint

SLACK_M = 1e-3
Line = Sequence[MapPoint]


def check_row_room(
    rows: Sequence[Line],
    standing: Sequence[Line],
    wheels_left_m: Sequence[float],
    wheel_width_m: float,
    clearance_m: float,
    machine: str,
) -> None:
    """Check that no wheel comes near any standing row while the robot straddles a row.

    `rows` are those that are worked, the first of those that stand; `wheels_left_m` is where the
    wheels are to the left of the robot's middle.
    Raises: MissionError: names the rows, the machine, and how far apart rows have to be.
    """
    import shapely

    lines = np.array([shapely.LineString(line) for line in standing])
    needed_m = clearance_m + wheel_width_m / 2.0
    sides_m = sorted({round(left_m, 6) for left_m in wheels_left_m})
    if not sides_m or len(lines) < 2:
        return
    reach_m = max(map(abs, sides_m)) + needed_m
    pairs = shapely.STRtree(lines).query(lines[: len(rows)], predicate="dwithin", distance=reach_m)
    for row, other in sorted(zip(*pairs.tolist(), strict=True)):
        if row == other:
            continue
        gap_m = min(
            float(lines[other].distance(lines[row].offset_curve(left_m))) for left_m in sides_m
        )
        if gap_m < needed_m - SLACK_M:
            apart_m, track_m = lines[row].distance(lines[other]), sides_m[-1] - sides_m[0]
            left_m = max(0.0, gap_m - wheel_width_m / 2.0)
            raise MissionError(
                RowsTight(row + 1, other + 1, machine, apart_m, track_m, wheel_width_m, left_m,
                          clearance_m, reach_m)
            )  # fmt: skip
