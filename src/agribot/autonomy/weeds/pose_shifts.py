"""How corrections of the pose shift it against what the robot saw a moment ago.

Between two estimates the robot moves as its wheels and its gyro say; the rest of the difference is
a correction, by a fix or by a row. What was seen lately is known from the robot, not from the map:
it takes part in the correction. So the error of a cheap receiver, which wanders by centimetres
while a plant passes from the picture to the tool, is no error of the tool's.
"""

from __future__ import annotations

import math
from bisect import bisect_left

from agribot.autonomy.weeds.poses import MAX_GAP_S, SPAN_S, PoseAt
from agribot.core.arithmetic import clamp
from agribot.core.geo import wrap_rad
from agribot.core.messages import Estimate
from agribot.core.pose import Pose2

UNSHIFTED = Pose2(0.0, 0.0, 0.0)
# Change of the way by corrections over this many metres is an error of the wheels, not the wander
# of a receiver; no single correction counts more than that.
SCALE_MEMORY_M, LEAST_WAY_M = 20.0, 5.0
MAX_SCALE_RATIO, MAX_LOST_M = 0.03, 0.02
# Largest curvature at which the wheels slip as along a row.
STRAIGHT_RADPM = 0.2


class WayScale:
    """Ratio of the way to that of the wheels, from the corrections along it."""

    def __init__(self) -> None:
        self._way_m = LEAST_WAY_M
        self._gained_m = 0.0

    @property
    def ratio(self) -> float:
        return clamp(self._gained_m / self._way_m, -MAX_SCALE_RATIO, MAX_SCALE_RATIO)

    def learn(self, way_m: float, gained_m: float) -> None:
        """Learn from a correction that added `gained_m` to a way of the wheels."""
        kept = math.exp(-abs(way_m) / SCALE_MEMORY_M)
        gained_m = clamp(gained_m, -MAX_LOST_M, MAX_LOST_M)
        self._way_m = LEAST_WAY_M + kept * (self._way_m - LEAST_WAY_M) + abs(way_m)
        self._gained_m = kept * self._gained_m + math.copysign(1.0, way_m) * gained_m


class PoseShifts:
    """Feed every estimate to `add`; shifts lead from places of the map to places of the map."""

    def __init__(self, span_s: float = SPAN_S) -> None:
        self._span_s = span_s
        self._last: Estimate | None = None
        self._times_s: list[float] = []
        self._totals: list[Pose2] = []
        self._scale = WayScale()
        self.total = UNSHIFTED  # sum of all corrections until now
        self.way_m = 0.0  # driven until now

    def add(self, estimate: Estimate) -> None:
        """Add an estimate; over a gap, or one that is not ok, the correction is unknown."""
        before, self._last = self._last, estimate if estimate.ok else None
        if before is None or self._last is None or estimate.t_s <= before.t_s:
            return
        dt_s = estimate.t_s - before.t_s
        self.way_m += abs(estimate.v_mps) * min(dt_s, MAX_GAP_S)
        if dt_s <= MAX_GAP_S:
            self.total = self._find_correction(before, estimate).compose(self.total)
        self._times_s.append(estimate.t_s)
        self._totals.append(self.total)
        if estimate.t_s - self._times_s[0] > 2.0 * self._span_s:
            old = bisect_left(self._times_s, estimate.t_s - self._span_s)
            del self._times_s[:old]
            del self._totals[:old]

    def follow(self, pose: PoseAt, until: Pose2) -> PoseAt:
        """Shift a remembered pose by the corrections since its time, up to the total `until`."""
        at = min(bisect_left(self._times_s, pose.t_s), len(self._times_s) - 1)
        if at < 0:
            return pose
        shift = until.compose(self._totals[at].inverse())
        moved = shift.compose(pose.map_from_body)
        return PoseAt(
            t_s=pose.t_s,
            x_map_m=moved.x_m,
            y_map_m=moved.y_m,
            yaw_map_rad=moved.yaw_rad,
            cov=pose.cov,
        )

    def _find_correction(self, before: Estimate, after: Estimate) -> Pose2:
        """Find the shift from where wheels and gyro lead to where the estimate is."""
        dt_s = after.t_s - before.t_s
        wheels_m = (before.v_mps + after.v_mps) / 2.0 * dt_s
        way_m = wheels_m * (1.0 + self._scale.ratio)
        turn_rad = (before.yaw_rate_radps + after.yaw_rate_radps) / 2.0 * dt_s
        course_rad = before.yaw_map_rad + after.slip_rad + turn_rad / 2.0
        led = Pose2(
            before.x_map_m + way_m * math.cos(course_rad),
            before.y_map_m + way_m * math.sin(course_rad),
            wrap_rad(before.yaw_map_rad + turn_rad),
        )
        if abs(turn_rad) < STRAIGHT_RADPM * abs(wheels_m):
            ahead_m, _ = led.locate(after.x_map_m, after.y_map_m)
            self._scale.learn(wheels_m, ahead_m + way_m - wheels_m)
        now = Pose2(after.x_map_m, after.y_map_m, after.yaw_map_rad)
        return now.compose(led.inverse())
