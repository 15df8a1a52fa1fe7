"""A path made ready for driving: speed, tool and waypoints at each of its points."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.config import MissionConfig
from agribot.errors import MissionError
from agribot.messages import Path
from agribot.plan.progress import Progress
from agribot.plan.speed import speed_profile
from agribot.plan.visits import Visits

# The tool sits up to this far from the body's origin, and must work to the last plant.
TOOL_REACH_M = 0.6


class Route:
    """Plain lists beside a path, and how far the robot has come on it."""

    def __init__(
        self,
        path: Path,
        known_rows: Sequence[int],
        config: MissionConfig,
        waypoints: Sequence[tuple[float, float]],
        tool_reach_m: float = TOOL_REACH_M,
    ) -> None:
        """Raises: MissionError: the path misses a waypoint or works an unknown row."""
        self.path = path
        self.row: list[int] = path.row.tolist()
        self.planned_rows = sorted(set(self.row) - {-1})
        unknown = sorted(set(self.planned_rows) - set(known_rows))
        if unknown:
            raise MissionError(f"the path works rows {unknown} that the field has not")
        self.visits = Visits(path, waypoints, config.waypoint_radius_m)
        self.progress = Progress(path)
        self._speed_mps = speed_profile(path, config)
        self._yaw_map_rad: list[float] = path.yaw_map_rad.tolist()
        self._tool = _tool_points(self.row, path.s_m.tolist(), tool_reach_m)

    def change_speed(self, config: MissionConfig) -> None:
        self._speed_mps = speed_profile(self.path, config)

    @property
    def row_here(self) -> int:
        return self.row[self.progress.index]

    @property
    def max_speed_mps(self) -> float:
        return self._speed_mps[self.progress.index]

    @property
    def yaw_map_rad(self) -> float:
        return self._yaw_map_rad[self.progress.index]

    @property
    def tool_on(self) -> bool:
        return self._tool[self.progress.index]


def _tool_points(row: Sequence[int], s_m: Sequence[float], reach_m: float) -> list[bool]:
    """Where the tool may work: in the rows and within its reach of their ends."""
    is_on = [index >= 0 for index in row]
    for order in (range(len(row)), range(len(row) - 1, -1, -1)):
        last_in_row_m = math.inf
        for point in order:
            if row[point] >= 0:
                last_in_row_m = s_m[point]
            elif abs(s_m[point] - last_in_row_m) <= reach_m:
                is_on[point] = True
    return is_on
