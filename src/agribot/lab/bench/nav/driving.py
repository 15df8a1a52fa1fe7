"""The mission of many robots on one path: progress, speed, caution, as in agribot.autonomy.plan."""

from __future__ import annotations

import numpy as np

from agribot.autonomy.plan.boustrophedon import plan_rows
from agribot.autonomy.plan.caution import caution_ratio
from agribot.autonomy.plan.mission import END_TOLERANCE_M, SETTLE_S
from agribot.autonomy.plan.route import Route
from agribot.autonomy.plan.rows import lay_rows
from agribot.core.config import MissionConfig
from agribot.core.messages import FloatArray, Path
from agribot.core.robot import RobotSpec
from agribot.lab.bench.nav.batch.arrays import clamp
from agribot.lab.bench.nav.batch.follower import BatchFollower
from agribot.lab.bench.nav.batch.localizer import BatchEstimate
from agribot.lab.bench.nav.scenario import DT_S, TICK_STEPS, Scenario

AHEAD = 50  # points, as agribot.autonomy.plan.progress


class BatchProgress:
    """As plan.progress.Progress."""

    def __init__(self, count: int, path: Path) -> None:
        self._path = path
        self._last = len(path.s_m) - 1
        self._spacing_m = np.append(np.diff(path.s_m), 0.0)
        self.index = np.zeros(count, dtype=np.int64)
        self.s_m = np.zeros(count)

    def advance(self, x_m: FloatArray, y_m: FloatArray) -> None:
        best, searching = self._square_m2(self.index, x_m, y_m), np.ones_like(x_m, dtype=bool)
        for _ in range(AHEAD - 1):
            ahead = np.minimum(self.index + 1, self._last)
            square = self._square_m2(ahead, x_m, y_m)
            searching = searching & (ahead > self.index) & ~(square > best)
            if not searching.any():
                break
            self.index = np.where(searching, ahead, self.index)
            best = np.where(searching, square, best)
        path, index = self._path, self.index
        yaw_rad = path.yaw_map_rad[index]
        dx, dy = x_m - path.xy_map_m[index, 0], y_m - path.xy_map_m[index, 1]
        along_m = np.cos(yaw_rad) * dx + np.sin(yaw_rad) * dy
        on_m = path.s_m[index] + clamp(along_m, 0.0, self._spacing_m[index])
        self.s_m = np.maximum(self.s_m, on_m)

    def _square_m2(self, index: np.ndarray, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        dx, dy = x_m - self._path.xy_map_m[index, 0], y_m - self._path.xy_map_m[index, 1]
        square: FloatArray = dx * dx + dy * dy
        return square


class BatchDriving:
    """From estimates to twists; `row` is the row of the field that each robot works, or -1."""

    def __init__(self, count: int, scenario: Scenario, robot: RobotSpec) -> None:
        self._config: MissionConfig = scenario.mission()
        rows = lay_rows(scenario.field())
        start = (*(scenario.field().start_map_m or (0.0, 0.0)), 0.0)
        self.path = plan_rows(rows, start, robot, self._config)
        route = Route(self.path, [row.index for row in rows], self._config, ())
        self._speed_mps, self._tool = route_limits(route, self.path)
        self.progress = BatchProgress(count, self.path)
        self.follower = BatchFollower(count, scenario.control(), robot, self.path)
        self.is_done = np.zeros(count, dtype=bool)
        self.row = np.full(count, -1, dtype=np.int64)
        self.tool_on = np.zeros(count, dtype=bool)
        self.paused_s = np.zeros(count)
        self._ok_since_s: float | None = None

    def step(self, t_s: float, estimate: BatchEstimate) -> None:
        if not estimate.ok:
            return
        if self._ok_since_s is None:
            self._ok_since_s = t_s
        if t_s - self._ok_since_s < SETTLE_S:
            return
        x_m, y_m = estimate.x_map_m, estimate.y_map_m
        self.progress.advance(x_m, y_m)
        index = self.progress.index
        self.is_done |= self.progress.s_m >= self.path.s_m[-1] - END_TOLERANCE_M
        self.row = np.where(self.is_done, -1, self.path.row[index])
        self.tool_on = self._tool[index] & ~self.is_done
        caution = self._caution(estimate, index)
        limit_mps = np.where(self.is_done, 0.0, caution * self._speed_mps[index])
        self.paused_s += (limit_mps == 0.0) & ~self.is_done
        self.follower.step(
            (x_m, y_m, estimate.yaw_map_rad), estimate.v_mps, estimate.yaw_rate_radps,
            estimate.slip_rad, self.progress.s_m, limit_mps, TICK_STEPS * DT_S,
        )  # fmt: skip

    def _caution(self, estimate: BatchEstimate, index: np.ndarray) -> FloatArray:
        std_m = across_std_m(estimate.cov, self.path.yaw_map_rad[index])
        ratio = np.ones_like(std_m)
        for robot in np.flatnonzero(self._tool[index] & (std_m > self._config.full_speed_std_m)):
            ratio[robot] = caution_ratio(float(std_m[robot]), self._config)
        return ratio


def across_std_m(cov: FloatArray, yaw_map_rad: FloatArray) -> FloatArray:
    """As plan.caution.across_std_m; `cov` (3, 3, N)."""
    sin, cos = np.sin(yaw_map_rad), np.cos(yaw_map_rad)
    across_m2 = cov[0, 0] * sin * sin - 2.0 * cov[0, 1] * sin * cos + cov[1, 1] * cos * cos
    std_m: FloatArray = np.sqrt(np.maximum(across_m2, 0.0))
    return std_m


def route_limits(route: Route, path: Path) -> tuple[FloatArray, np.ndarray]:
    """Speed limit and tool state at each point of the path, as the route tells them."""
    speed, tool = [], []
    for index in range(len(path.s_m)):
        route.progress.index = index
        speed.append(route.max_speed_mps)
        tool.append(route.tool_row >= 0)
    route.progress.index = 0
    return np.array(speed), np.array(tool)
