"""Path following: state feedback in distance on the pose that the robot will have.

The law is the pole placement of the linearised lateral error over driven distance, with both
poles at about 1 / length_m, so it behaves the same at every speed. Actuator lag and dead time
are met by predicting the pose over `delay_s` with the measured twist.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from agribot.autonomy.control import law
from agribot.autonomy.control.stalled_turn import StalledTurn
from agribot.autonomy.control.yaw_gain import YawGain
from agribot.core.arithmetic import clamp, view_floats
from agribot.core.config import ControlConfig
from agribot.core.geo import is_backwards, wrap_rad
from agribot.core.messages import STOP, DriveCommand, Estimate, Goal, Path, Tracking
from agribot.core.robot import RobotSpec

PIVOT_ENTER_RAD = math.radians(50.0)
PIVOT_LEAVE_RAD = math.radians(10.0)
PIVOT_GAIN_PER_S = 1.5
NOMINAL_DT_S = 0.02
MAX_DT_S = 0.1
CORNER_REACH_M = 0.03
MAX_ASIDE_M = 0.05  # margin of a certified plan to every edge


class _Errors(NamedTuple):
    cross_track_m: float
    heading_rad: float
    curvature_radpm: float
    is_backwards: bool = False
    is_corner: bool = False

    def steered_at(self, tracked_x_m: float, slip_rad: float) -> _Errors:
        """As of a point ahead on the body: the robot crabs on a slope, and its line moves aside.

        In a steady crab the heading is off by minus the slip, and with it the point's place.
        """
        aside_m = law.clamp(tracked_x_m * slip_rad, MAX_ASIDE_M)
        return self._replace(cross_track_m=self.cross_track_m - aside_m)


class _Line:
    """A path as plain floats: indexing an array costs more than the control law."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._x = view_floats(path.xy_map_m[:, 0])
        self._y = view_floats(path.xy_map_m[:, 1])
        self._yaw = view_floats(path.yaw_map_rad)
        self._curvature = view_floats(path.curvature_radpm)
        self._s = view_floats(path.s_m)
        self._row: list[int] = path.row.tolist()
        backwards = is_backwards(path.xy_map_m, path.yaw_map_rad)
        self._is_backwards = cast(Sequence[bool], backwards.data)
        stands = np.diff(path.s_m) <= 0.0
        self._corners_m: list[float] = path.s_m[1:][stands].tolist()

    def errors(self, s_m: float, x_m: float, y_m: float, yaw_rad: float) -> _Errors:
        """Errors of a pose at the path's point beside it; `s_m` is within a metre of that."""
        index = self._index(s_m)
        first = self._index(self._find_corner_m(s_m))
        for _ in range(2):  # the second look corrects for curvature that began in between
            along_m, left_m = self._offset(index, x_m, y_m)
            on_m = self._s[index] + _arc_m(along_m, left_m, self._curvature[index])
            index = max(self._index(on_m), first)
        _, left_m = self._offset(index, x_m, y_m)
        heading_rad = wrap_rad(yaw_rad - self._yaw[index])
        return _Errors(
            left_m, heading_rad, self._curvature[index], self._is_backwards[index],
            self._is_corner(s_m),
        )  # fmt: skip

    def is_between_rows(self, s_m: float) -> bool:
        """Return whether no crop stands beside the wheels."""
        return self._row[self._index(s_m)] < 0

    def _find_corner_m(self, s_m: float) -> float:
        """Find where the path last turned on the spot; what lies before it is over."""
        behind = bisect_right(self._corners_m, s_m)
        return self._corners_m[behind - 1] if behind else self._s[0]

    def _is_corner(self, s_m: float) -> bool:
        """Just behind a place where the path turns on the spot."""
        behind = bisect_right(self._corners_m, s_m)
        return behind > 0 and s_m - self._corners_m[behind - 1] <= CORNER_REACH_M

    def _index(self, s_m: float) -> int:
        return clamp(bisect_right(self._s, s_m) - 1, 0, len(self._s) - 1)

    def _offset(self, index: int, x_m: float, y_m: float) -> tuple[float, float]:
        dx, dy = x_m - self._x[index], y_m - self._y[index]
        along_m, left_m = law.offset(dx, dy, self._yaw[index])
        return (-along_m, -left_m) if self._is_backwards[index] else (along_m, left_m)


def _arc_m(along_m: float, left_m: float, curvature_radpm: float) -> float:
    """Distance along an arc to the point beside (along, left) in the frame of its start."""
    if curvature_radpm == 0.0:
        return along_m
    return math.atan2(curvature_radpm * along_m, 1.0 - curvature_radpm * left_m) / curvature_radpm


class Follower:
    """Turns the mission's goal into a twist, ramped as the drive allows."""

    def __init__(self, config: ControlConfig, robot: RobotSpec) -> None:
        self._config = config
        self._drive = robot.drive
        self._max_yaw_rate_radps = min(config.max_yaw_rate_radps, robot.drive.max_yaw_rate_radps)
        self._line: _Line | None = None
        self._last = STOP
        self._last_t_s: float | None = None
        self._is_pivoting = False
        self._yaw_gain = YawGain(max(config.delay_s, NOMINAL_DT_S))
        self._stalled_turn = StalledTurn()

    def step(
        self, estimate: Estimate, goal: Goal, dt_s: float | None = None
    ) -> tuple[DriveCommand, Tracking | None]:
        """`dt_s` since the last step; without it, from the times of the estimates.

        Without a path or a finite pose there is nothing to track: STOP and None.
        """
        if goal.path is None or not _is_finite(estimate):
            self._last = STOP
            return STOP, None
        if self._line is None or self._line.path is not goal.path:
            self._line = _Line(goal.path)
        dt_s = self._elapsed_s(estimate.t_s) if dt_s is None else dt_s
        here = self._line.errors(goal.s_m, estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        beside_m = here.cross_track_m + goal.tracked_x_m * math.sin(here.heading_rad)
        tracking = Tracking(
            s_m=goal.s_m, cross_track_m=beside_m, heading_error_rad=here.heading_rad
        )
        self._yaw_gain.learn(
            self._last.v_mps, self._last.yaw_rate_radps,
            estimate.v_mps, estimate.yaw_rate_radps, dt_s,
        )  # fmt: skip
        if goal.status.state not in ("running", "paused"):
            self._last, self._is_pivoting = STOP, False
            self._stalled_turn.restart()
            return STOP, tracking
        wanted = STOP
        if goal.max_speed_mps > 0.0:
            ahead = self._ahead(self._line, estimate, goal.s_m)
            ahead = ahead.steered_at(goal.tracked_x_m, estimate.slip_rad)
            wanted = self._twist(ahead, estimate, goal.max_speed_mps)
        if goal.max_speed_mps > 0.0 and self._line.is_between_rows(goal.s_m):
            wanted = self._break_loose(wanted, estimate.yaw_rate_radps, dt_s)
        else:
            self._stalled_turn.restart()
        self._last = self._ramp(wanted, dt_s)
        return self._last, tracking

    def _elapsed_s(self, t_s: float) -> float:
        last_s, self._last_t_s = self._last_t_s, t_s
        if last_s is None:
            return NOMINAL_DT_S
        return clamp(t_s - last_s, 0.0, MAX_DT_S)

    def _ahead(self, line: _Line, estimate: Estimate, s_m: float) -> _Errors:
        """Errors of the pose that the robot reaches before a new command takes effect."""
        pose = estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad
        there = law.ahead(
            pose, estimate.v_mps, estimate.yaw_rate_radps, estimate.slip_rad,
            self._config.delay_s,
        )  # fmt: skip
        return line.errors(s_m, *there)

    def _twist(self, ahead: _Errors, estimate: Estimate, max_speed_mps: float) -> DriveCommand:
        heading_rad = ahead.heading_rad
        is_strict = self._is_pivoting or ahead.is_corner
        limit_rad = PIVOT_LEAVE_RAD if is_strict else PIVOT_ENTER_RAD
        self._is_pivoting = abs(heading_rad) > limit_rad
        if self._is_pivoting:
            yaw_rate = -PIVOT_GAIN_PER_S * heading_rad
            limit = self._max_yaw_rate_radps
            return DriveCommand(v_mps=0.0, yaw_rate_radps=law.clamp(yaw_rate, limit))
        errors = (ahead.cross_track_m, heading_rad, ahead.curvature_radpm)
        v_mps, yaw_rate = law.steer(
            errors, estimate.slip_rad, max_speed_mps, self._yaw_gain.ratio,
            self._config.length_m, self._max_yaw_rate_radps,
        )  # fmt: skip
        # Backwards the same law holds: left of the way, which is right of the robot, counts.
        return DriveCommand(v_mps=-v_mps if ahead.is_backwards else v_mps, yaw_rate_radps=yaw_rate)

    def _break_loose(
        self, wanted: DriveCommand, yaw_rate_radps: float, dt_s: float
    ) -> DriveCommand:
        """Turn on the spot for a moment where the wheels of a turn spin and the robot stands."""
        expected_radps, limit_radps = self._yaw_gain.expected_radps, self._max_yaw_rate_radps
        rate_radps = self._stalled_turn.watch(expected_radps, yaw_rate_radps, limit_radps, dt_s)
        return DriveCommand(v_mps=0.0, yaw_rate_radps=rate_radps) if rate_radps else wanted

    def _ramp(self, wanted: DriveCommand, dt_s: float) -> DriveCommand:
        drive, last = self._drive, self._last
        return DriveCommand(
            v_mps=law.ramp(wanted.v_mps, last.v_mps, drive.max_accel_mps2 * dt_s),
            yaw_rate_radps=law.ramp(
                wanted.yaw_rate_radps, last.yaw_rate_radps,
                drive.max_yaw_accel_radps2 * dt_s,
            ),
        )  # fmt: skip


def _is_finite(estimate: Estimate) -> bool:
    pose = estimate.x_map_m + estimate.y_map_m + estimate.yaw_map_rad
    return math.isfinite(pose + estimate.v_mps + estimate.yaw_rate_radps + estimate.slip_rad)
