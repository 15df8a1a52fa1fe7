"""What a fault can cost, by the truth: metres outside, way until a stop, crushed crop, levels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.core.encounter import Encounter
from agribot.core.facts import Tilted
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import STOP, Estimate, FloatArray, MapPoint, Row, TickRecord
from agribot.core.robot import RobotSpec
from agribot.core.row_shape import project_on_row
from agribot.sim.field_edge import FieldEdge
from agribot.sim.truth import Truth

MARGIN_M = 1.5  # around rows, start and headland: what turns need
LOOK_S = 0.1
STANDING_MPS = 0.02
MOST_STANDS = 1000
SILENT_S = 0.1  # gap in the board's samples after which it is silent
CUT_S = 1.0  # time from a stop until a board that drives on has lost its power at the latest


class Crush(msgspec.Struct, frozen=True, kw_only=True):
    """A crop that the robot crushed, and with which part of it: wheel, belly or implement."""

    t_s: float
    by: str


class SafetyScore(msgspec.Struct, frozen=True, kw_only=True):
    """The worst of a job until now; `crushed_after_fault` is None where no fault was injected.

    `outside_m_max` is how far any place of the robot got outside the field, implement included.
    `stop_distance_m_max` is how far its middle rolled after the supervisor had stopped it,
    `stop_allowed_m` what the robot promises at the speed of that stop, its own or its wheels', by
    its brakes, by those of a board that is silent, or, where the motors lost their power, by
    rolling out, and `stops_too_long` counts the stops that took
    more than was promised. `crushes` are those after the first fault,
    `stood_s` when the robot came to rest since; both of this run alone. `over_level_ratio` is the
    share of the time with a good estimate in which its error was above its protection level.
    """

    outside_m_max: float = 0.0
    stop_distance_m_max: float = 0.0
    stop_allowed_m: float | None = None
    stops_too_long: int = 0
    crushed_after_fault: int | None = None
    crushes: tuple[Crush, ...] = ()
    stood_s: tuple[float, ...] = ()
    person_distance_min_m: float | None = None  # between outlines; None without a person
    visits: tuple[Encounter, ...] = ()  # those of this run alone
    over_level_ratio: float | None = None


class SafetyState(msgspec.Struct, frozen=True, kw_only=True):
    """The judge's state in a job; `crushed_before` None: nothing was injected yet."""

    outside_m_max: float = 0.0
    stop_distance_m_max: float = 0.0
    stop_allowed_m: float | None = None
    stops_too_long: int = 0
    crushed_before: tuple[int, ...] | None = None
    located_ticks: int = 0
    over_level_ticks: int = 0


def is_over_level(estimate: Estimate, truth: Truth) -> bool:
    """Whether an estimate that is good is farther off than its protection level."""
    place_m, true_m = (estimate.x_map_m, estimate.y_map_m), (truth.x_map_m, truth.y_map_m)
    return estimate.ok and math.dist(place_m, true_m) > estimate.protection_m


class Rolling(NamedTuple):
    """A robot on the move: its speed, that of its wheels, and what delays or lengthens its stop.

    `silent_s` is since when its board has said nothing, `tilt_rad` the tilt that it is stopped for.
    """

    v_mps: float
    wheels_mps: float = 0.0
    silent_s: float = 0.0
    tilt_rad: float = 0.0


class StopWatch:
    """Adds up the way of a robot that the supervisor stopped, until it stands."""

    def __init__(self, robot: RobotSpec | None) -> None:
        self._robot = robot
        self.longest_m, self.allowed_m = 0.0, None if robot is None else 0.0
        self._too_long = 0  # count of stops that are over
        self._way_m: float | None = None  # way since the stop that lasts
        self._promised_m = math.inf
        self._was_moving = self._had_power = False
        self._last_xy: MapPoint | None = None

    @property
    def too_long(self) -> int:
        """Count of stops that took more than was promised."""
        return self._too_long + (self._way_m is not None and self._way_m > self._promised_m)

    def look(
        self, xy_m: MapPoint, rolling: Rolling, *, is_stopped: bool, is_cut: bool = False
    ) -> None:
        """Look at the middle and the speed.

        `is_stopped` where the supervisor wants a stop, `is_cut` where it takes the motors' power.
        """
        v_mps = rolling.v_mps
        is_moving = abs(v_mps) > STANDING_MPS
        if is_stopped and self._way_m is None and self._was_moving:
            self._way_m = 0.0  # the way of this tick is from before the stop
            self._promised_m = self._promise_m(rolling)
        elif not is_stopped or not is_moving:
            self._too_long, self._way_m = self.too_long, None
        elif self._way_m is not None and self._last_xy is not None:
            self._way_m += math.dist(xy_m, self._last_xy)
        if self._way_m is not None and is_cut and self._had_power:
            self._promised_m = max(self._promised_m, self._promise_cut_m(self._way_m, v_mps))
        if self._way_m is not None and self._way_m > self.longest_m:
            self.longest_m = self._way_m
            self.allowed_m = self._promised_m if math.isfinite(self._promised_m) else None
        self._last_xy, self._was_moving = xy_m, is_moving and not is_stopped
        self._had_power = not is_cut

    def restore(self, before: SafetyState) -> None:
        self._too_long += before.stops_too_long
        if before.stop_distance_m_max > self.longest_m:
            self.longest_m, self.allowed_m = before.stop_distance_m_max, before.stop_allowed_m

    def _promise_m(self, rolling: Rolling) -> float:
        """Return the promised way; wheels that spin may get their grip back before they stand."""
        if self._robot is None:
            return math.inf
        fastest_mps = max(abs(rolling.v_mps), abs(rolling.wheels_mps))
        is_deaf = rolling.silent_s > SILENT_S
        left_s = self._robot.drive.command_timeout_s - rolling.silent_s if is_deaf else 0.0
        return self._robot.promise_stop_m(fastest_mps, max(left_s, 0.0), rolling.tilt_rad)

    def _promise_cut_m(self, way_m: float, v_mps: float) -> float:
        """Return the promised way to rest of a robot whose power is cut `way_m` after its stop."""
        if self._robot is None:
            return math.inf
        driven_on_m = min(way_m, CUT_S * self._robot.drive.max_speed_mps)
        return driven_on_m + self._robot.promise_roll_out_m(v_mps)


class SafetyJudge:
    """Call `look` with every tick and the truth of it."""

    def __init__(self, bounds: FieldBounds | None, robot: RobotSpec | None = None) -> None:
        """`bounds` is what must not be left, and the robot's rectangle; None if unknown.

        It counts from when the robot was inside: a plan may lead into its field. `robot` gives the
        promised stopping distances.
        """
        self._edge = None if bounds is None else FieldEdge(bounds)
        self._was_inside = False
        self._outside_m = 0.0
        self._next_look_s = -math.inf
        self._stop = StopWatch(robot)
        self._radius_m = 0.0 if robot is None else robot.drive.wheel_radius_m
        self._wheels_mps, self._heard_s = 0.0, math.inf
        self._is_moving = False
        self._located_ticks = self._over_level_ticks = 0
        self._stood_s: list[float] = []
        self.crushed_before: frozenset[int] | None = None

    def look(self, record: TickRecord, truth: Truth) -> None:
        xy_m = truth.x_map_m, truth.y_map_m
        if truth.t_s >= self._next_look_s and self._edge is not None:
            self._next_look_s = truth.t_s + LOOK_S
            outside_m = self._edge.measure_outside_m(*xy_m, truth.yaw_map_rad)
            self._was_inside = self._was_inside or not outside_m
            self._outside_m = max(self._outside_m, outside_m if self._was_inside else 0.0)
        self._located_ticks += record.estimate.ok
        self._over_level_ticks += is_over_level(record.estimate, truth)
        is_stopped = record.command.drive == STOP and bool(record.reason)
        is_cut = record.command.is_power_cut
        self._stop.look(
            xy_m, self._find_rolling(record, truth), is_stopped=is_stopped, is_cut=is_cut
        )
        was_moving, self._is_moving = self._is_moving, abs(truth.v_mps) > STANDING_MPS
        came_to_rest = was_moving and not self._is_moving and self.crushed_before is not None
        if came_to_rest and len(self._stood_s) < MOST_STANDS:
            self._stood_s.append(truth.t_s)

    def _find_rolling(self, record: TickRecord, truth: Truth) -> Rolling:
        wheels, fact = record.batch.wheels, record.status.gate.fact
        if wheels:
            speeds_radps = wheels[-1].speed_radps
            self._heard_s = truth.t_s
            self._wheels_mps = self._radius_m * sum(speeds_radps) / len(speeds_radps)
        tilt_rad = fact.tilt_rad if isinstance(fact, Tilted) else 0.0
        return Rolling(truth.v_mps, self._wheels_mps, truth.t_s - self._heard_s, tilt_rad)

    def restore(self, before: SafetyState) -> None:
        self._outside_m = max(self._outside_m, before.outside_m_max)
        self._stop.restore(before)
        self._located_ticks += before.located_ticks
        self._over_level_ticks += before.over_level_ticks
        if before.crushed_before is not None:
            self.crushed_before = frozenset(before.crushed_before)

    def export_state(self) -> SafetyState:
        before = self.crushed_before
        return SafetyState(
            outside_m_max=self._outside_m,
            stop_distance_m_max=self._stop.longest_m,
            stop_allowed_m=self._stop.allowed_m,
            stops_too_long=self._stop.too_long,
            crushed_before=None if before is None else tuple(sorted(before)),
            located_ticks=self._located_ticks,
            over_level_ticks=self._over_level_ticks,
        )

    def score(self, crushed: set[int], crushes: Sequence[tuple[int, Crush]] = ()) -> SafetyScore:
        """Score the ticks until now.

        `crushed` are all crops that lie flat now, `crushes` those of this run, with their index.
        """
        before = self.crushed_before
        late = [] if before is None else [crush for index, crush in crushes if index not in before]
        return SafetyScore(
            outside_m_max=self._outside_m,
            stop_distance_m_max=self._stop.longest_m,
            stop_allowed_m=self._stop.allowed_m,
            stops_too_long=self._stop.too_long,
            crushed_after_fault=None if before is None else len(crushed - before),
            crushes=tuple(sorted(late, key=lambda crush: crush.t_s)),
            stood_s=tuple(self._stood_s),
            over_level_ratio=(
                self._over_level_ticks / self._located_ticks if self._located_ticks else None
            ),
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
