"""A field plan made ready for driving: dense points, and the stretches to be worked as rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from agribot.autonomy.plan.coverage.area import FieldArea, FieldPlan, Leg, PlanRequest
from agribot.autonomy.plan.coverage.free_space import FreeSpace
from agribot.autonomy.plan.coverage.plan_certificate import check_crop, check_ways
from agribot.autonomy.plan.coverage.ways import Ways
from agribot.autonomy.plan.ways.curves import SPACING_M, Place, make_path
from agribot.autonomy.plan.ways.footprint import Footprint
from agribot.autonomy.plan.ways.speed import plan_speed_mps, time_left_s
from agribot.core.config import MissionConfig
from agribot.core.errors import MissionError
from agribot.core.facts import (
    AtHome,
    FarFromGround,
    NoRoomToFace,
    PlaceUnfit,
    PlanLong,
    ThereAlready,
    WayCrossesCrop,
    WayRefused,
)
from agribot.core.field_bounds import FieldBounds
from agribot.core.messages import FloatArray, MapPoint, Path, Row
from agribot.core.pose import Pose2

STRETCH_M = 0.05  # largest deviation of the straight stretches that replace a bent working leg
MAX_LENGTH_M = 100_000.0  # 5 million places of the path, as much memory as a small computer has
MAX_OUTSIDE_M = 50.0
RUN_IN_M = 0.2  # straight to a place at which the robot is to look somewhere


class FieldWork:
    """The parts of a plan that a mission needs: its rows, and its path from the robot's place."""

    def __init__(
        self, plan: FieldPlan, area: FieldArea, shape: Footprint, request: PlanRequest
    ) -> None:
        """Take a certified plan. Raises: MissionError: it is longer than a mission can hold."""
        length_m = sum(leg.length_m for leg in plan.legs)
        if length_m > MAX_LENGTH_M:
            raise MissionError(PlanLong(length_m, MAX_LENGTH_M))
        self.area, self.request = area, request
        self._shape = shape
        self.legs = plan.legs
        self.length_m = length_m
        self.rows, self._row_of_piece = _split_stretches(plan.legs)
        self.bounds = FieldBounds(
            rings_map_m=tuple(np.array(ring) for ring in (area.boundary, *area.holes)),
            front_m=shape.front_m,
            rear_m=shape.rear_m,
            half_width_m=shape.half_width_m,
        )

    def measure_time_s(self, mission: MissionConfig) -> float:
        """Count the time at the speeds of a mission, with its ramps and turns in place."""
        path = sample_legs(self.legs, self._row_of_piece)
        return time_left_s(path, plan_speed_mps(path, mission))[0]

    @property
    def has_crop(self) -> bool:
        return bool(self.area.rows)

    def plan_from(self, start_pose: tuple[float, float, float]) -> Path:
        """Plan the way from the robot to the plan, around every obstacle, and the plan.

        Raises: MissionError: the robot stands where no such way begins.
        """
        start, first = start_pose[:2], self.legs[0].xy_map_m[0]
        way_in = self._plan_way(start, (float(first[0]), float(first[1])))
        return sample_legs([*way_in, *self.legs], [*([None] * len(way_in)), *self._row_of_piece])

    def plan_home(self, start: MapPoint, home: MapPoint, row_ahead: FloatArray) -> Path:
        """Plan to the end of the row under the robot, (N, 2), and around all obstacles home.

        Raises: MissionError: the robot stands where no such way begins.
        """
        legs = []
        if len(row_ahead) > 1:
            legs.append(Leg(kind="arc", xy_map_m=row_ahead))
            start = (float(row_ahead[-1, 0]), float(row_ahead[-1, 1]))
        legs += self._plan_way(start, home)
        if not legs:
            raise MissionError(AtHome())
        return sample_legs(legs, [None] * len(legs))

    def plan_to(self, start: MapPoint, goal: Place) -> Path:
        """Plan around every obstacle to a place on which the robot can turn in place.

        Raises: MissionError: the place is outside, in an obstacle, on crop or too near to them.
        """
        import shapely

        x_m, y_m, yaw_rad = goal
        place = (x_m, y_m)
        space = self._make_space()
        if not space.drivable.covers(shapely.Point(place)):
            raise MissionError(PlaceUnfit(x_m, y_m, self._judge_place(place)))
        before = place
        if yaw_rad is not None:  # the robot turns there and drives the rest as it is to look
            before = Pose2(x_m, y_m, yaw_rad).transform(-RUN_IN_M, 0.0)
            if not space.drivable.covers(shapely.LineString((before, place))):
                raise MissionError(NoRoomToFace(x_m, y_m))
        legs = self._plan_way(start, before)
        if before != place:
            legs.append(Leg(kind="link", xy_map_m=np.array([before, place])))
        return self._check(legs, start)

    def plan_back(self, start: MapPoint, goal: Place) -> Path:
        """Plan to a place of the plan itself, which may be nearer to an edge than it can turn.

        Raises: MissionError: no such way keeps the robot inside the field and off the crop.
        """
        return self._check(self._plan_way(start, goal[:2]), start)

    def _check(self, legs: list[Leg], start: MapPoint) -> Path:
        if not legs:
            raise MissionError(ThereAlready())
        problems = check_ways(tuple(legs), self.area, self._shape, self.request, start)
        if problems:
            raise MissionError(WayRefused(problems[0].fact))
        return sample_legs(legs, [None] * len(legs))

    def _judge_place(self, place: MapPoint) -> Literal["beyond", "obstacle", "crop", "edge"]:
        """Why a robot cannot turn at a place."""
        import shapely

        here = shapely.Point(place)
        if not shapely.Polygon(self.area.boundary).covers(here):
            return "beyond"
        if any(shapely.Polygon(hole).covers(here) for hole in self.area.holes):
            return "obstacle"
        rows = [shapely.LineString(row) for row in self.area.standing]
        if rows and shapely.MultiLineString(rows).distance(here) < self._row_clearance_m:
            return "crop"
        return "edge"

    def _make_space(self) -> FreeSpace:
        import shapely

        space = FreeSpace(self.area, self._shape, self.request)
        if self.area.standing:
            rows = [shapely.LineString(row) for row in self.area.standing]
            space.remove(shapely.union_all(shapely.buffer(rows, self._row_clearance_m)))
        return space

    def _plan_way(self, start: MapPoint, goal: MapPoint) -> list[Leg]:
        """Inside the field, around what is in the way.

        A place outside, or closer to an edge than the robot can turn, is left or reached by the
        straight line to the nearest ground on which it can.
        """
        if math.dist(start, goal) < SPACING_M:
            return []
        space = self._make_space()
        inner = [space.nearest(place) for place in (start, goal)]
        for place, near in zip((start, goal), inner, strict=True):
            if math.dist(place, near) > MAX_OUTSIDE_M:
                away_m = math.dist(place, near)
                raise MissionError(FarFromGround(*place, away_m, MAX_OUTSIDE_M))
        corners = np.array([start, *Ways(space.region, space.drivable).way(*inner), goal])
        steps_m = np.hypot(*np.diff(corners, axis=0).T)
        way = Leg(kind="link", xy_map_m=corners[np.concatenate([[True], steps_m > 1e-6])])
        crushed = check_crop((way,), self.area, self._shape, self.request, start)
        if crushed:
            raise MissionError(WayCrossesCrop(crushed[0].fact))
        return [way]

    @property
    def _row_clearance_m(self) -> float:
        return self._shape.wheel_turn_radius_m + self.request.turn_clearance_m


def _split_stretches(legs: tuple[Leg, ...]) -> tuple[tuple[Row, ...], list[list[int] | None]]:
    """Straight rows, and per leg the row of each of its pieces; None where nothing is worked."""
    rows: list[Row] = []
    of_piece: list[list[int] | None] = []
    for leg in legs:
        if not leg.tool_on:
            of_piece.append(None)
            continue
        numbers: list[int] = []
        for first, last in _find_straight_parts(leg.xy_map_m):
            (x0, y0), (x1, y1) = leg.xy_map_m[first].tolist(), leg.xy_map_m[last].tolist()
            numbers += [len(rows)] * (last - first)
            rows.append(Row(index=len(rows), start_map_m=(x0, y0), end_map_m=(x1, y1)))
        of_piece.append(numbers)
    return tuple(rows), of_piece


def _find_straight_parts(xy: FloatArray) -> list[tuple[int, int]]:
    parts, first = [], 0
    while first < len(xy) - 1:
        last = first + 1
        while last + 1 < len(xy) and _measure_bulge_m(xy[first : last + 2]) <= STRETCH_M:
            last += 1
        parts.append((first, last))
        first = last
    return parts


def _measure_bulge_m(xy: FloatArray) -> float:
    """Measure the largest distance of points from the line of the first and the last."""
    along = xy[-1] - xy[0]
    offset = xy[1:-1] - xy[0]
    cross = along[0] * offset[:, 1] - along[1] * offset[:, 0]
    return float(np.max(np.abs(cross)) / max(math.hypot(*along), 1e-9))


def sample_legs(legs: Sequence[Leg], rows: list[list[int] | None]) -> Path:
    """Lay points 2 cm apart; where the robot turns in place, or back, one stands twice."""
    blocks, done_m = [], 0.0
    for leg, numbers in zip(legs, rows, strict=True):
        pieces = _break_up(leg) if leg.kind == "link" else [leg.xy_map_m]
        for xy in pieces:
            block = _sample_line(xy, done_m, numbers or [-1] * (len(xy) - 1), leg.is_reverse)
            done_m = float(block[-1, 5])
            blocks.append(block)
    table = np.concatenate(blocks)
    same = (np.diff(table[:, 5]) <= 0.0) & (_measure_turns_rad(table[:, 2]) < 1e-3)
    table = table[np.concatenate([[True], ~same])]
    table[:, 2] += np.pi * table[:, 6]  # backwards the robot looks against its course
    return make_path(table)


def _break_up(leg: Leg) -> list[FloatArray]:
    return [leg.xy_map_m[k : k + 2] for k in range(len(leg.xy_map_m) - 1)]


def _measure_turns_rad(yaw: FloatArray) -> FloatArray:
    return np.asarray(np.abs(np.angle(np.exp(1j * np.diff(yaw)))))


def _sample_line(xy: FloatArray, done_m: float, rows: list[int], is_reverse: bool) -> FloatArray:
    """Columns x, y, course, curvature, row, s, is_reverse along a line without corners.

    The course at a bend is the mean of the two pieces; along a piece it goes over from one end
    to the other, as on the arc that the pieces are chords of.
    """
    step = np.diff(xy, axis=0)
    length_m = np.hypot(*step.T)
    course = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    at_ends = np.concatenate([course[:1], (course[:-1] + course[1:]) / 2.0, course[-1:]])
    blocks = []
    for k in range(len(step)):
        count = max(1, math.ceil(length_m[k] / SPACING_M - 1e-9))
        ratio = np.arange(count + (k == len(step) - 1)) / count
        table = np.empty((len(ratio), 7))
        table[:, :2] = xy[k] + ratio[:, None] * step[k]
        table[:, 2] = at_ends[k] + ratio * (at_ends[k + 1] - at_ends[k])
        table[:, 3] = (at_ends[k + 1] - at_ends[k]) / length_m[k]
        table[:, 4] = rows[k]
        table[:, 5] = done_m + float(length_m[:k].sum()) + ratio * length_m[k]
        table[:, 6] = is_reverse
        blocks.append(table)
    return np.concatenate(blocks)
