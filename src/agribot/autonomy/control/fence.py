"""Where the robot may be: inside a field whose edge is known, else in a box around its path.

The robot must be able to stop inside. Its rectangle is judged where it is and where it would come
to rest: as it is believed to stand, less a tolerance, since a plan leads along the very edge and a
robot follows it to a few centimetres; and as far off as it may well be, less what may be risked.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from agribot.core.arithmetic import clamp
from agribot.core.config import SafetyConfig
from agribot.core.facts import (
    BeyondField,
    Fact,
    LeavesBox,
    LeavesField,
    NearEdgeAndDoubted,
    NearEdgeAndUnsure,
)
from agribot.core.field_bounds import FieldBounds
from agribot.core.geo import std_along_m
from agribot.core.messages import DriveCommand, Estimate, FloatArray, GnssQuality, Goal, Path
from agribot.core.pose import Pose2
from agribot.core.robot import REACTION_S

# Way between two searches for edges: less than half the robot, so that none is passed unseen.
RECHECK_M = 0.25
# A way in or out leaves the field; within this distance of it only the box counts.
AWAY_M, AWAY_STEP_M = 2.0, 0.2
LEAST_HALF_M = 0.05
# Distance that a robot moving away from an edge must gain, as a share of its way.
DEEPER_RATIO = 0.5
WITHOUT_CARRIER = (GnssQuality.SINGLE, GnssQuality.DGNSS)
MOST_MPS, MOST_RADPS = 3.0, 3.0  # no wish is taken for more; what is sent has limits of its own


class Fence(Protocol):
    def objection(self, estimate: Estimate, drive: DriveCommand, goal: Goal) -> Fact | None:
        """Why the robot must not move like this here; None where it may."""
        ...


class PathFence(NamedTuple):
    """Axis-aligned rectangle in the map that the robot may not leave."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float
    decel_mps2: float = math.inf  # deceleration of the brakes

    @classmethod
    def around(cls, path: Path, margin_m: float, decel_mps2: float = math.inf) -> PathFence:
        (x_min_m, y_min_m), (x_max_m, y_max_m) = (
            path.xy_map_m.min(axis=0),
            path.xy_map_m.max(axis=0),
        )
        return cls(
            float(x_min_m) - margin_m, float(y_min_m) - margin_m,
            float(x_max_m) + margin_m, float(y_max_m) + margin_m, decel_mps2,
        )  # fmt: skip

    def holds(self, x_map_m: float, y_map_m: float) -> bool:
        return self.x_min_m <= x_map_m <= self.x_max_m and self.y_min_m <= y_map_m <= self.y_max_m

    def objection(self, estimate: Estimate, drive: DriveCommand, goal: Goal) -> Fact | None:
        here = (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        is_in = self.holds(*here[:2])
        if is_in and self.holds(*predict_rest(here, drive, self.decel_mps2)[:2]):
            return None
        return LeavesBox(*here[:2], is_inside=is_in)


class _Edges:
    """The edges of the field, those near a place at hand."""

    def __init__(self, bounds: FieldBounds) -> None:
        rings = bounds.rings_map_m
        self._from = np.concatenate(rings)
        self._to = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
        self._along = self._to - self._from
        self._length2 = np.maximum(np.einsum("ij,ij->i", self._along, self._along), 1e-12)
        self._place, self._range_m = (math.inf, math.inf), -1.0
        self._near: list[tuple[float, float, float, float]] = []  # middle and half of its reach
        self._is_inside = False

    def touch(
        self, pose: tuple[float, float, float], box: tuple[float, float, float, float]
    ) -> bool:
        """Whether a rectangle of the body (rear, front, right, left) leaves the field."""
        x_m, y_m, yaw_rad = pose
        rear_m, front_m, right_m, left_m = box
        reach_m = math.hypot(max(front_m, -rear_m), max(left_m, -right_m))
        if (
            math.dist((x_m, y_m), self._place) > min(RECHECK_M, 0.9 * front_m, 0.9 * left_m)
            or reach_m > self._range_m
        ):
            self._look_around(x_m, y_m, reach_m)
        if not self._is_inside:
            return True
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        middle_m, half_x_m, half_y_m = (
            (rear_m + front_m) / 2.0, (front_m - rear_m) / 2.0, (left_m - right_m) / 2.0,
        )  # fmt: skip
        aside_m = (right_m + left_m) / 2.0
        # An edge and the rectangle are apart when one of three axes parts them; plain numbers,
        # since few edges are near.
        for edge_x, edge_y, arm_x, arm_y in self._near:
            x, y = edge_x - x_m, edge_y - y_m
            x, y = cos * x + sin * y - middle_m, cos * y - sin * x - aside_m
            along, across = cos * arm_x + sin * arm_y, cos * arm_y - sin * arm_x
            reach_x, reach_y = abs(along), abs(across)
            if (
                abs(x) <= half_x_m + reach_x
                and abs(y) <= half_y_m + reach_y
                and abs(x * across - y * along) <= half_x_m * reach_y + half_y_m * reach_x
            ):
                return True
        return False

    def measure_distance_m(
        self, pose: tuple[float, float, float], box: tuple[float, float, float, float]
    ) -> float:
        """Measure from a rectangle of the body to the nearest edge; nothing where it leaves."""
        if self.touch(pose, box):
            return 0.0
        rear_m, front_m, right_m, left_m = box
        body = Pose2(*pose)
        x_m, y_m = body.locate(self._from[:, 0], self._from[:, 1])
        past_x_m = np.maximum(np.maximum(rear_m - x_m, x_m - front_m), 0.0)
        past_y_m = np.maximum(np.maximum(right_m - y_m, y_m - left_m), 0.0)
        corners = [body.transform(x, y) for x in (rear_m, front_m) for y in (right_m, left_m)]
        edges_m = [self._measure_edges_m(*corner).min() for corner in corners]
        return min(float(np.hypot(past_x_m, past_y_m).min()), *map(float, edges_m))

    def _measure_edges_m(self, x_m: float, y_m: float) -> FloatArray:
        """Measure from a place to each edge, (N,)."""
        start = self._from - (x_m, y_m)
        part = np.clip(-np.einsum("ij,ij->i", start, self._along) / self._length2, 0.0, 1.0)
        distance_m: FloatArray = np.hypot(*(start + part[:, None] * self._along).T)
        return distance_m

    def _look_around(self, x_m: float, y_m: float, reach_m: float) -> None:
        self._place, self._range_m = (x_m, y_m), reach_m + RECHECK_M
        here = np.array((x_m, y_m))
        start, end = self._from - here, self._to - here
        is_near = self._measure_edges_m(x_m, y_m) <= self._range_m + RECHECK_M
        middle, arm = (self._from + self._to) / 2.0, self._along / 2.0
        self._near = [
            (x, y, along_x, along_y)
            for x, y, along_x, along_y in np.hstack([middle, arm])[is_near].tolist()
        ]
        is_across = (start[:, 1] > 0.0) != (end[:, 1] > 0.0)
        start, along = start[is_across], self._along[is_across]
        crossing_m = start[:, 0] - start[:, 1] * along[:, 0] / along[:, 1]
        self._is_inside = bool(np.count_nonzero(crossing_m > 0.0) % 2)


class FieldFence:
    """The edge of the field and its holes: it counts from when the robot is inside."""

    def __init__(self, bounds: FieldBounds, config: SafetyConfig, decel_mps2: float) -> None:
        self.bounds, self._config, self._decel_mps2 = bounds, config, decel_mps2
        self._here, self._rest, self._ahead = (_Edges(bounds) for _ in range(3))
        self._was_inside = False
        self._led_out: tuple[Path | None, float, bool] = None, math.nan, False

    def objection(self, estimate: Estimate, drive: DriveCommand, goal: Goal) -> Fact | None:
        along_std_m, across_std_m = _std_m(estimate)
        believed = self._box(-self._config.fence_tolerance_m, -self._config.fence_tolerance_m)
        along_m, unknown_m = (
            measure_growth_m(std_m, estimate.quality, self._config)
            for std_m in (along_std_m, across_std_m)
        )
        box = self._box(along_m, max(unknown_m, self._split_m(estimate)))
        here = (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        at_rest = predict_rest(here, drive, self._decel_mps2)
        was_inside = self._was_inside
        if not was_inside:
            self._was_inside = not self._here.touch(here, self._box(0.0, 0.0))
        if not was_inside or not (self._here.touch(here, box) or self._rest.touch(at_rest, box)):
            return None
        if self._leads_out(goal):
            return None
        place = here[:2]
        if self._here.touch(here, believed):
            return BeyondField(*place)
        if self._rest.touch(at_rest, believed):
            return LeavesField(*place, is_by_hand=False)
        if self._split_m(estimate) > unknown_m:
            return NearEdgeAndDoubted(*place, estimate.across_protection_m)
        unsure = NearEdgeAndUnsure(*place, max(along_std_m, across_std_m))
        return None if self._leads_deeper(here, at_rest) else unsure

    def crossing(self, estimate: Estimate, drive: DriveCommand) -> LeavesField | None:
        """Find that a hand is about to take the robot, as it is believed to stand, out.

        One that is out already may be brought back as its driver sees fit.
        """
        box = self._box(-self._config.fence_tolerance_m, -self._config.fence_tolerance_m)
        here = (estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
        at_rest = predict_rest(here, drive, self._decel_mps2)
        if self._here.touch(here, box) or not self._rest.touch(at_rest, box):
            return None
        return LeavesField(*here[:2], is_by_hand=True)

    def _split_m(self, estimate: Estimate) -> float:
        """Say how far to its side the robot is where the sensors contradict each other.

        What of the protection level is mere ignorance counts by its sigma already.
        """
        config = self._config
        ignorance_m = max(estimate.across_plain_m, estimate.across_unknown_m)
        split_m = estimate.across_protection_m - ignorance_m
        if not math.isfinite(split_m):
            return -config.fence_tolerance_m
        forgiven_m = 0.0 if estimate.quality in WITHOUT_CARRIER else config.fence_unsure_m
        return max(split_m - forgiven_m, -config.fence_tolerance_m)

    def _leads_deeper(
        self, here: tuple[float, float, float], at_rest: tuple[float, float, float]
    ) -> bool:
        """Whether a robot too uncertain for where it is moves away from every edge.

        That makes nothing worse, whereas one that is put down near an edge would stand for good.
        """
        if here == at_rest:
            return False
        box = self._box(0.0, 0.0)
        deeper_m = self._here.measure_distance_m(at_rest, box)
        deeper_m -= self._here.measure_distance_m(here, box)
        return deeper_m >= DEEPER_RATIO * math.dist(here[:2], at_rest[:2])

    def _box(self, along_m: float, across_m: float) -> tuple[float, float, float, float]:
        """Return the robot's box, enlarged by these margins along and across its body."""
        bounds = self.bounds
        front_m = max(bounds.front_m + along_m, LEAST_HALF_M)
        rear_m = max(bounds.rear_m + along_m, LEAST_HALF_M)
        side_m = max(bounds.half_width_m + across_m, LEAST_HALF_M)
        return -rear_m, front_m, -side_m, side_m

    def _leads_out(self, goal: Goal) -> bool:
        """Whether the way itself, which was checked before, leaves the field near here."""
        path = goal.path
        if path is None:
            return False
        known_path, known_m, is_out = self._led_out
        if path is known_path and abs(goal.s_m - known_m) < AWAY_STEP_M:
            return is_out
        box = self._box(-self._config.fence_tolerance_m, -self._config.fence_tolerance_m)
        first, last = np.searchsorted(path.s_m, (goal.s_m - AWAY_M, goal.s_m + AWAY_M)).tolist()
        step = max(1, round(AWAY_STEP_M / 0.02))
        is_out = any(
            self._ahead.touch((*path.xy_map_m[i].tolist(), float(path.yaw_map_rad[i])), box)
            for i in range(first, min(last + 1, len(path.s_m)), step)
        )
        self._led_out = path, goal.s_m, is_out
        return is_out


def measure_growth_m(std_m: float, quality: GnssQuality, config: SafetyConfig) -> float:
    """Measure by how much the body counts as larger, for what is not known of its position.

    Errors of a receiver without carrier corrections last for minutes, and the wheels' add up:
    the mission may drive along the edge for as long, so that nothing is forgiven.
    """
    if quality in WITHOUT_CARRIER:
        return max(config.fence_single_sigma * std_m, -config.fence_tolerance_m)
    return max(config.fence_sigma * std_m - config.fence_unsure_m, -config.fence_tolerance_m)


def predict_rest(
    here: tuple[float, float, float], drive: DriveCommand, decel_mps2: float
) -> tuple[float, float, float]:
    """Predict the pose after braking from what is wanted now, on the same arc."""
    x_m, y_m, yaw_rad = here
    v_mps = clamp(drive.v_mps, -MOST_MPS, MOST_MPS)
    way_m = v_mps * REACTION_S + v_mps * abs(v_mps) / (2.0 * decel_mps2)
    yaw_rate_radps = clamp(drive.yaw_rate_radps, -MOST_RADPS, MOST_RADPS)
    turn_rad = yaw_rate_radps * (REACTION_S if v_mps == 0.0 else way_m / v_mps)
    course_rad = yaw_rad + turn_rad / 2.0
    return (
        x_m + way_m * math.cos(course_rad), y_m + way_m * math.sin(course_rad),
        yaw_rad + turn_rad,
    )  # fmt: skip


def _std_m(estimate: Estimate) -> tuple[float, float]:
    """1 sigma of the position along the body and across it."""
    xx, xy, _, _, yy, *_ = estimate.pose_cov
    pose = Pose2(estimate.x_map_m, estimate.y_map_m, estimate.yaw_map_rad)
    return std_along_m((xx, xy, yy), pose.ahead), std_along_m((xx, xy, yy), pose.left)
