"""A path made ready for driving: speed, tool and waypoints at each of its points."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.config import MissionConfig
from agribot.errors import MissionError
from agribot.messages import FloatArray, Path
from agribot.plan.progress import Progress
from agribot.plan.speed import speed_profile, time_left_s
from agribot.plan.visits import Visits

# The tool sits up to this far from the body's origin, and must work to the last plant.
TOOL_REACH_M = 0.6
STRAIGHT_RAD = 1e-6  # from point to point


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
        self._time_left_s = time_left_s(path, self._speed_mps)
        self._yaw_map_rad: list[float] = path.yaw_map_rad.tolist()
        self._next_row = _next_rows(self.row)
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
    def next_row(self) -> int:
        """The first row ahead of the robot that it is not in; -1 behind the last."""
        return self._next_row[self.progress.index]

    @property
    def row_ahead(self) -> FloatArray:
        """What is left of the row under the robot, (N, 2); nothing between rows."""
        first = last = self.progress.index
        while self.row[first] >= 0 and last < len(self.row) and self.row[last] == self.row[first]:
            last += 1
        return self.path.xy_map_m[first:last]

    @property
    def before_row(self) -> int:
        """Where the straight piece before the row under the robot begins; between rows: here."""
        index = self.progress.index
        if self.row[index] < 0:
            return index
        row, yaw_rad = self.row[index], self._yaw_map_rad
        while (
            index > 0
            and self.row[index - 1] in (row, -1)
            and abs(yaw_rad[index - 1] - yaw_rad[index]) < STRAIGHT_RAD
        ):
            index -= 1
        return index

    @property
    def place(self) -> tuple[float, float]:
        """Of the path, where the robot is to be."""
        x_m, y_m = self.path.xy_map_m[self.progress.index]
        return float(x_m), float(y_m)

    @property
    def time_left_s(self) -> float:
        return self._time_left_s[self.progress.index]

    def go_on(self, s_m: float, reached: Sequence[bool]) -> None:
        """Begin in the middle, where an earlier mission was cut off."""
        self.progress.jump(s_m)
        self.visits.restore(reached)

    @property
    def tool_on(self) -> bool:
        return self._tool[self.progress.index]


def _next_rows(row: Sequence[int]) -> list[int]:
    """For each point, the first row behind it that it is not in; -1 behind the last."""
    result, following, current = [-1] * len(row), -1, -1
    for point in range(len(row) - 1, -1, -1):
        if row[point] not in (-1, current):
            following, current = current, row[point]
        result[point] = following if row[point] == current else current
    return result


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
