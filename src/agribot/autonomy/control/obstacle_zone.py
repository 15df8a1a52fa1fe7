"""The way ahead of the robot, which must be free of people and things.

Each sensor of obstacles reports the nearest points around the robot. The robot's rectangle is put
along the path that it is about to drive: the way until it would touch a point decides whether the
robot stands, drives slowly or drives on.
"""

from __future__ import annotations

import math

import numpy as np

from agribot.core.config import SafetyConfig
from agribot.core.facts import (
    NotHeardYet,
    ObstacleInWay,
    ObstacleNearWay,
    SensorSilent,
)
from agribot.core.keep_out import BodyBox
from agribot.core.messages import Estimate, FloatArray, Goal, ObstacleSample, SensorBatch
from agribot.core.pose import Pose2

SLOW_MPS = 0.2  # speed near obstacles
MARGIN_M = 0.2  # distance around the body that must be free
ASIDE_M = 1.0  # distance beside the body within which an obstacle makes it slow
STEP_M = 0.1  # distance between two places of the robot's rectangle along the path
SIGMAS = 2.0  # sigmas of a point by which the rectangle is larger
FREE_S = 1.0  # time for which the way must have been free before the robot drives on
NOWHERE = (math.inf, math.inf)


class ObstacleZone:
    """Call `update` once a tick; `stop` and `slow` are then what is in the way and near it."""

    def __init__(self, config: SafetyConfig, body: BodyBox, *, must_report: bool) -> None:
        """`must_report`: the robot has a sensor of obstacles, which must not be silent."""
        self._config, self._body = config, body
        self.is_there = must_report and config.stops_for_obstacles
        self._heard_s = -math.inf
        self._stop, self._slow = _Memory(), _Memory()
        self.stop: ObstacleInWay | None = None
        self.slow: ObstacleNearWay | None = None

    def update(self, batch: SensorBatch, estimate: Estimate, goal: Goal) -> None:
        """Take in what was seen since the last tick."""
        if not self._config.stops_for_obstacles:
            return
        self._heard_s = min(self._heard_s, batch.t_s)  # a time stamp in the future counts as now
        for sample in batch.obstacles:
            self._heard_s = max(self._heard_s, min(sample.t_s, batch.t_s))
            self._measure(batch.t_s, sample, estimate, goal)
        way_m = self._stop.recall(batch.t_s)
        self.stop = ObstacleInWay(way_m) if math.isfinite(way_m) else None
        way_m = self._slow.recall(batch.t_s)
        self.slow = ObstacleNearWay(way_m) if math.isfinite(way_m) else None

    @property
    def most_mps(self) -> float:
        """Largest speed near what is there."""
        return math.inf if self.slow is None else SLOW_MPS

    def unheard(self) -> NotHeardYet | None:
        """Find that the sensor never spoke."""
        is_unheard = self.is_there and self._heard_s == -math.inf
        return NotHeardYet("lidar") if is_unheard else None

    def silence(self, t_s: float) -> SensorSilent | None:
        """Find that the sensor spoke and does not any more."""
        silent_s, limit_s = t_s - self._heard_s, self._config.sensor_timeout_s
        if self._heard_s == -math.inf or silent_s <= limit_s:
            return None
        return SensorSilent("lidar", silent_s, limit_s, "lidar")

    def _measure(self, t_s: float, sample: ObstacleSample, estimate: Estimate, goal: Goal) -> None:
        """Measure the ways until the robot would touch one of the points, and pass by near it."""
        config, unsure_m = self._config, SIGMAS * sample.std_m
        margin_m = MARGIN_M + unsure_m
        poses = find_poses(estimate, goal, config.obstacle_slow_m)
        points_m = np.array(sample.points_body_m).reshape(-1, 2)
        stop_m = measure_way_m(poses, points_m, self._grow(margin_m, margin_m))
        aside_m = ASIDE_M + unsure_m
        slow_m = measure_way_m(poses, points_m, self._grow(margin_m, aside_m))
        self._stop.note(t_s, stop_m if stop_m <= config.obstacle_stop_m else math.inf)
        self._slow.note(t_s, slow_m)

    def _grow(self, along_m: float, across_m: float) -> BodyBox:
        front_m, rear_m, half_width_m = self._body
        return BodyBox(front_m + along_m, rear_m + along_m, half_width_m + across_m)


class _Memory:
    """The way to what was seen last, which is kept until the way was free for a time."""

    def __init__(self) -> None:
        self._way_m, self._seen_s = math.inf, -math.inf

    def note(self, t_s: float, way_m: float) -> None:
        if math.isfinite(way_m):
            self._way_m, self._seen_s = way_m, t_s

    def recall(self, t_s: float) -> float:
        """Return the way; infinite where it is free."""
        return self._way_m if 0.0 <= t_s - self._seen_s <= FREE_S else math.inf


def find_poses(estimate: Estimate, goal: Goal, ahead_m: float) -> FloatArray:
    """Find where the path leads from the robot, (n, 4): way, x, y and yaw in the body frame.

    The first pose is where the robot is.
    """
    here = np.zeros((1, 4))
    path = goal.path
    if path is None or not estimate.ok:
        return here
    first, last = np.searchsorted(path.s_m, (goal.s_m, goal.s_m + ahead_m)).tolist()
    steps = _choose_steps(path.s_m[first : last + 1], path.yaw_map_rad[first : last + 1]) + first
    body = Pose2(estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
    x_m, y_m = body.locate(path.xy_map_m[steps, 0], path.xy_map_m[steps, 1])
    yaw_rad = path.yaw_map_rad[steps] - estimate.yaw_map_rad
    ahead = np.column_stack([path.s_m[steps] - goal.s_m, x_m, y_m, yaw_rad])
    return np.concatenate([here, ahead])


def _choose_steps(s_m: FloatArray, yaw_rad: FloatArray) -> FloatArray:
    """Choose points of a path that are `STEP_M` apart, or turned by as much at its rim."""
    if not len(s_m):
        return np.zeros(0, dtype=np.int64)
    turned_rad = np.abs(np.diff(np.unwrap(yaw_rad), prepend=yaw_rad[0]))
    gone_m = np.cumsum(np.diff(s_m, prepend=s_m[0]) + turned_rad)
    _, first = np.unique(np.floor(gone_m / STEP_M), return_index=True)
    chosen: FloatArray = np.append(first, len(s_m) - 1)
    return chosen


def measure_way_m(poses: FloatArray, points_m: FloatArray, body: BodyBox) -> float:
    """Measure the way until a rectangle that is led along poses holds a point; else infinite."""
    if not len(points_m):
        return math.inf
    cos, sin = np.cos(poses[:, 3])[:, None], np.sin(poses[:, 3])[:, None]
    x_m, y_m = points_m[:, 0] - poses[:, 1:2], points_m[:, 1] - poses[:, 2:3]
    along_m, left_m = cos * x_m + sin * y_m, cos * y_m - sin * x_m
    is_in = (along_m <= body.front_m) & (along_m >= -body.rear_m)
    is_in &= np.abs(left_m) <= body.half_width_m
    touched = is_in.any(axis=1)
    return float(poses[np.argmax(touched), 0]) if touched.any() else math.inf
