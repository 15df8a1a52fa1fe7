"""Where the robot was when a frame was captured: a short memory of estimates."""

from __future__ import annotations

from bisect import bisect_left

import msgspec

from agribot.core.geo import wrap_rad
from agribot.core.messages import Estimate
from agribot.core.pose import Pose2

SPAN_S = 3.0  # history of poses, longer than any camera plus network takes
MAX_GAP_S = 0.15  # longest gap; at 1 m/s and 1 rad/s a straight line over it is off by 3 mm
SAME_TIME_S = 1e-6


class PoseAt(msgspec.Struct, frozen=True, kw_only=True):
    """Pose of the body frame at a capture time.

    `cov` is the 3x3 covariance of (x_map_m, y_map_m, yaw_map_rad), row by row.
    """

    t_s: float
    x_map_m: float
    y_map_m: float
    yaw_map_rad: float
    cov: tuple[float, float, float, float, float, float, float, float, float]

    @property
    def map_from_body(self) -> Pose2:
        return Pose2(self.x_map_m, self.y_map_m, self.yaw_map_rad)


class PoseHistory:
    """Remembers the good estimates of the last seconds and interpolates between them."""

    def __init__(self, span_s: float = SPAN_S) -> None:
        self._span_s = span_s
        self._times_s: list[float] = []
        self._estimates: list[Estimate] = []

    def add(self, estimate: Estimate) -> None:
        """Keep an estimate; one that is not ok, or not newer than the last, is left out."""
        if not estimate.ok or (self._times_s and estimate.t_s <= self._times_s[-1]):
            return
        self._times_s.append(estimate.t_s)
        self._estimates.append(estimate)
        if estimate.t_s - self._times_s[0] > 2.0 * self._span_s:
            old = bisect_left(self._times_s, estimate.t_s - self._span_s)
            del self._times_s[:old]
            del self._estimates[:old]

    def at(self, t_s: float) -> PoseAt | None:
        """Find the pose at `t_s`; None if it is too old, in the future or in a gap."""
        if not self._times_s or t_s < self._times_s[-1] - self._span_s:
            return None
        after = bisect_left(self._times_s, t_s - SAME_TIME_S)
        if after == len(self._times_s):
            return None
        right = self._estimates[after]
        if abs(right.t_s - t_s) <= SAME_TIME_S:
            return _pose(right, t_s)
        if after == 0:
            return None
        left = self._estimates[after - 1]
        if right.t_s - left.t_s > MAX_GAP_S:
            return None
        return _between(left, right, t_s)


def _pose(estimate: Estimate, t_s: float) -> PoseAt:
    return PoseAt(
        t_s=t_s,
        x_map_m=estimate.x_map_m,
        y_map_m=estimate.y_map_m,
        yaw_map_rad=estimate.yaw_map_rad,
        cov=estimate.pose_cov,
    )


def _between(left: Estimate, right: Estimate, t_s: float) -> PoseAt:
    share = (t_s - left.t_s) / (right.t_s - left.t_s)
    turn_rad = wrap_rad(right.yaw_map_rad - left.yaw_map_rad)
    return PoseAt(
        t_s=t_s,
        x_map_m=left.x_map_m + share * (right.x_map_m - left.x_map_m),
        y_map_m=left.y_map_m + share * (right.y_map_m - left.y_map_m),
        yaw_map_rad=wrap_rad(left.yaw_map_rad + share * turn_rad),
        cov=right.pose_cov if share > 0.5 else left.pose_cov,
    )
