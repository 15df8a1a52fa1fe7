"""What a fault can cost, by the truth: metres outside the field, way until a stop, crushed crop."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.core.messages import STOP, FloatArray, MapPoint, Row, TickRecord
from agribot.core.row_shape import project_on_row
from agribot.sim.truth import Truth

MARGIN_M = 1.5  # of the headland around rows and start: what turns need, and the robot itself
LOOK_S = 0.1
STANDING_MPS = 0.02


class SafetyScore(msgspec.Struct, frozen=True, kw_only=True):
    """The worst of a job so far; `crushed_after_fault` is None where no fault was injected.

    The robot's middle counts: how far it got outside the field, and how far it rolled after the
    supervisor had stopped it.
    """

    outside_m_max: float = 0.0
    stop_distance_m_max: float = 0.0
    crushed_after_fault: int | None = None
    person_distance_min_m: float | None = None  # between outlines; None where there is nobody


class SafetyState(msgspec.Struct, frozen=True, kw_only=True):
    """The judge's state in a job; `crushed_before` None: nothing was injected yet."""

    outside_m_max: float = 0.0
    stop_distance_m_max: float = 0.0
    crushed_before: tuple[int, ...] | None = None


class SafetyJudge:
    """Call `look` with every tick and the truth of it."""

    def __init__(self, boundary_map_m: FloatArray | None) -> None:
        """`boundary_map_m` (N, 2) is what must not be left; None: nobody knows."""
        self.boundary_map_m = boundary_map_m
        self._outside_m = self._stop_m = 0.0
        self._next_look_s = -math.inf
        self._stopping_m: float | None = None
        self._was_moving = False
        self._last_xy: tuple[float, float] | None = None
        self.crushed_before: frozenset[int] | None = None

    def look(self, record: TickRecord, truth: Truth) -> None:
        xy_m = truth.x_map_m, truth.y_map_m
        if truth.t_s >= self._next_look_s and self.boundary_map_m is not None:
            self._next_look_s = truth.t_s + LOOK_S
            outside_m = measure_outside_m(self.boundary_map_m, *xy_m)
            self._outside_m = max(self._outside_m, outside_m)
        self._follow_stop(record, xy_m, is_moving=abs(truth.v_mps) > STANDING_MPS)

    def _follow_stop(
        self, record: TickRecord, xy_m: tuple[float, float], *, is_moving: bool
    ) -> None:
        """Add up the way of a robot that the supervisor stopped, until it stands."""
        is_stopped = record.command.drive == STOP and bool(record.reason)
        if is_stopped and self._stopping_m is None and self._was_moving:
            self._stopping_m = 0.0
        elif not is_stopped or not is_moving:
            self._stopping_m = None
        if self._stopping_m is not None and self._last_xy is not None:
            self._stopping_m += math.dist(xy_m, self._last_xy)
            self._stop_m = max(self._stop_m, self._stopping_m)
        self._last_xy, self._was_moving = xy_m, is_moving and not is_stopped

    def restore(self, before: SafetyState) -> None:
        self._outside_m = max(self._outside_m, before.outside_m_max)
        self._stop_m = max(self._stop_m, before.stop_distance_m_max)
        if before.crushed_before is not None:
            self.crushed_before = frozenset(before.crushed_before)

    def export_state(self) -> SafetyState:
        before = self.crushed_before
        return SafetyState(
            outside_m_max=self._outside_m,
            stop_distance_m_max=self._stop_m,
            crushed_before=None if before is None else tuple(sorted(before)),
        )

    def score(self, crushed: set[int]) -> SafetyScore:
        """Score what was seen so far; `crushed` are all crops that lie flat now."""
        before = self.crushed_before
        return SafetyScore(
            outside_m_max=self._outside_m,
            stop_distance_m_max=self._stop_m,
            crushed_after_fault=None if before is None else len(crushed - before),
        )


def find_boundary(
    rows: Sequence[Row], start_map_m: MapPoint | None, headland_m: float
) -> FloatArray | None:
    """Return the corners (4, 2) of the rectangle along the rows with headland and margin.

    The start lies in it, too. None without rows.
    """
    if not rows:
        return None
    first = rows[0]
    ends = [end for row in rows for end in (row.start_map_m, row.end_map_m)]
    middles = [_find_middle(row) for row in rows]
    points = np.array([*ends, *middles, *([] if start_map_m is None else [start_map_m])])
    dx_m, dy_m = np.subtract(first.end_map_m, first.start_map_m)
    yaw_rad = math.atan2(dy_m, dx_m)
    along = np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
    axes = np.stack((along, (-along[1], along[0])))
    turned = points @ axes.T
    room_m = headland_m + MARGIN_M
    (u0, v0), (u1, v1) = turned.min(0) - room_m, turned.max(0) + room_m
    corners: FloatArray = np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]]) @ axes
    return corners


def _find_middle(row: Row) -> MapPoint:
    """Return the point of a row that bends away farthest from its chord."""
    x_m, y_m = np.add(row.start_map_m, row.end_map_m) / 2.0
    left_m = float(project_on_row(row, float(x_m), float(y_m)).left_m)
    dx_m, dy_m = np.subtract(row.end_map_m, row.start_map_m)
    length_m = math.hypot(dx_m, dy_m) or 1.0
    return float(x_m + left_m * dy_m / length_m), float(y_m - left_m * dx_m / length_m)


def measure_outside_m(boundary_map_m: FloatArray, x_m: float, y_m: float) -> float:
    """Measure how far a point lies outside a ring (N, 2); 0 inside."""
    a, b = boundary_map_m, np.roll(boundary_map_m, -1, axis=0)
    edge, away = b - a, np.array([x_m, y_m]) - a
    crosses = (a[:, 1] > y_m) != (b[:, 1] > y_m)
    rise = np.where(crosses, edge[:, 1], 1.0)
    if np.count_nonzero(crosses & (away[:, 0] < away[:, 1] * edge[:, 0] / rise)) % 2:
        return 0.0
    share = np.clip((away * edge).sum(1) / (edge * edge).sum(1), 0.0, 1.0)
    return float(np.hypot(*(away - share[:, None] * edge).T).min())
