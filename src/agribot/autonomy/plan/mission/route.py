"""A path made ready for driving: speed, tool and waypoints at each of its points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agribot.autonomy.plan.mission.progress import PathProgress
from agribot.autonomy.plan.mission.visits import Visits
from agribot.autonomy.plan.ways.speed import plan_speed_mps, time_left_s
from agribot.core.arithmetic import view_floats
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import RowsUnknown
from agribot.core.messages import FloatArray, Path

# The tool works up to this far past the last plant, and the robot is careful as far from it.
TOOL_REACH_M = 0.6
STRAIGHT_RAD = 1e-6  # smallest turn between two points


class Tool(NamedTuple):
    """Tool point on the body, its way past the ends of a row, and the steered point.

    `tracked_x_m` is the point of the body that is to stay on the path while the tool works. A
    field plan has the way to the tool in it already: it takes `x_m` and `reach_m` as zero.
    """

    x_m: float = 0.0
    reach_m: float = TOOL_REACH_M
    tracked_x_m: float = 0.0


AT_ORIGIN = Tool()


class Route:
    """Plain lists beside a path, and how far the robot has come on it."""

    def __init__(
        self,
        path: Path,
        known_rows: Sequence[int],
        config: MissionConfig,
        waypoints: Sequence[tuple[float, float]],
        tool: Tool = AT_ORIGIN,
    ) -> None:
        """Make a path ready; the tool works while its own place on the body is near a row.

        Raises: MissionError: the path misses a waypoint or works an unknown row.
        """
        self.path = path
        self.row: list[int] = path.row.tolist()
        self.planned_rows = sorted(set(self.row) - {-1})
        unknown = sorted(set(self.planned_rows) - set(known_rows))
        if unknown:
            raise MissionError(RowsUnknown(tuple(unknown)))
        self.visits = Visits(path, waypoints, config.waypoint_radius_m)
        self.progress = PathProgress(path)
        self.change_speed(config)
        self._yaw_map_rad = view_floats(path.yaw_map_rad)
        self._next_row = _find_next_rows(self.row)
        self._bound_for = _find_row_ends(self.row)
        self._beside = _find_near_rows(path, tool.reach_m, 0.0)
        self._tool = _find_near_rows(path, tool.reach_m, tool.x_m)

    def change_speed(self, config: MissionConfig) -> None:
        self._speed_mps = plan_speed_mps(self.path, config)
        self._time_left_s = time_left_s(self.path, self._speed_mps)

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
        """The rest of the row under the robot, (N, 2); nothing between rows."""
        first = last = self.progress.index
        while self.row[first] >= 0 and last < len(self.row) and self.row[last] == self.row[first]:
            last += 1
        return self.path.xy_map_m[first:last]

    @property
    def before_row(self) -> int:
        """Start of the straight piece before the row under the robot; between rows: here."""
        index = self.progress.index
        if self.row[index] < 0:
            return index
        row, yaw_rad = self.row[index], self._yaw_map_rad
        while (
            index > 0
            and self.row[index - 1] in (row, -1)
            and (
                self.row[index - 1] == row
                or abs(yaw_rad[index - 1] - yaw_rad[index]) < STRAIGHT_RAD
            )
        ):
            index -= 1
        return index

    @property
    def place(self) -> tuple[float, float]:
        """Point of the path where the robot is to be."""
        x_m, y_m = self.path.xy_map_m[self.progress.index]
        return float(x_m), float(y_m)

    @property
    def time_left_s(self) -> float:
        return self._time_left_s[self.progress.index]

    @property
    def goal(self) -> tuple[float, float]:
        """Next goal of the robot: a waypoint, the end of its row or the next row's start.

        Behind the last row, and where there is neither, it is the end of the path.
        """
        waypoint = self.visits.next_point
        if waypoint is not None:
            return waypoint
        x_m, y_m = self.path.xy_map_m[self._bound_for[self.progress.index]]
        return float(x_m), float(y_m)

    def go_on(self, s_m: float, reached: Sequence[bool]) -> None:
        """Begin in the middle, where an earlier mission was cut off."""
        self.progress.jump(s_m)
        self.visits.restore(reached)

    @property
    def is_beside_row(self) -> bool:
        return self._beside[self.progress.index] >= 0

    @property
    def tool_row(self) -> int:
        """The row that the tool is to work here, or -1."""
        return self._tool[self.progress.index]


def _find_next_rows(row: Sequence[int]) -> list[int]:
    """Find for each point the first row behind it that it is not in; -1 behind the last."""
    result, following, current = [-1] * len(row), -1, -1
    for point in range(len(row) - 1, -1, -1):
        if row[point] not in (-1, current):
            following, current = current, row[point]
        result[point] = following if row[point] == current else current
    return result


def _find_row_ends(row: Sequence[int]) -> list[int]:
    """Find for each point the last one of its row; between rows the first one of the next."""
    result, last = [0] * len(row), len(row) - 1
    for point in range(len(row) - 1, -1, -1):
        is_end = row[point] >= 0 and (point + 1 == len(row) or row[point + 1] != row[point])
        is_start = row[point] < 0 and point + 1 < len(row) and row[point + 1] >= 0
        last = point if is_end else point + 1 if is_start else last
        result[point] = last
    return result


def _find_near_rows(path: Path, reach_m: float, ahead_m: float) -> list[int]:
    """Find for each point the row within reach of a place `ahead_m` on the body, or -1.

    Where the robot turns between rows, none is.
    """
    near = path.row.copy() if ahead_m == 0.0 else np.full(len(path.row), -1)
    edges = np.flatnonzero(np.diff(path.row)) + 1
    for run in np.split(np.arange(len(path.row)), edges):
        row = int(path.row[run[0]])
        if row < 0:
            continue
        first_m, last_m = path.s_m[run[[0, -1]]] - ahead_m
        first = np.searchsorted(path.s_m, first_m - reach_m)
        last = np.searchsorted(path.s_m, last_m + reach_m, side="right")
        within = near[first:last]
        within[within < 0] = row
    near[(path.row < 0) & (path.curvature_radpm != 0.0)] = -1
    found: list[int] = near.tolist()
    return found
