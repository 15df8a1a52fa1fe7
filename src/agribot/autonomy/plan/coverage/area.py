"""What a field plan is made from and what it consists of; metres in the map frame."""

from __future__ import annotations

import math
from typing import Literal

import msgspec
import numpy as np

from agribot.core.messages import FloatArray, MapPoint
from agribot.core.robot import RobotSpec

MapLine = tuple[MapPoint, ...]
LegKind = Literal["swath", "headland", "row", "link", "arc", "reverse"]
TurnStyle = Literal["auto", "pivot", "arc", "three-point"]
WORKING: tuple[LegKind, ...] = ("swath", "headland", "row")
MARGIN_M, MOST_MARGIN_M = 0.05, 10.0  # to every edge, for a robot that knows where it is; limit
# Largest part of the margin that also counts to crop where the robot turns.
MOST_CROP_MARGIN_M = 0.5


class FieldArea(msgspec.Struct, frozen=True, kw_only=True):
    """A field: outer ring, holes that must not be entered, and what is marked in it.

    Rings do not repeat their first point. `rows` are crop rows to be straddled, `crop` rows that
    stand there, maybe beyond the boundary, and are not worked: no wheel comes near them. The
    swaths run along `ab_line`, from its first to its last point. `margin_m` is the default margin
    of a plan between the footprint and every edge.
    """

    boundary: MapLine
    holes: tuple[MapLine, ...] = ()
    rows: tuple[MapLine, ...] = ()
    crop: tuple[MapLine, ...] = ()
    ab_line: MapLine = ()
    waypoints: MapLine = ()
    margin_m: float = MARGIN_M
    left_out: str = ""  # omitted contents of the file, in one line

    @property
    def standing(self) -> tuple[MapLine, ...]:
        """All rows of crop, worked or not."""
        return (*self.rows, *self.crop)

    def choose_margin_m(self, asked_m: float | None) -> float:
        return self.margin_m if asked_m is None else asked_m


class Footprint(msgspec.Struct, frozen=True, kw_only=True):
    """Rectangle in the body frame that holds robot and implement, and the wheels inside it."""

    front_m: float
    rear_m: float  # positive backwards
    half_width_m: float
    wheel_xy_body_m: tuple[MapPoint, ...] = ()
    wheel_half_width_m: float = 0.0
    wheel_radius_m: float = 0.0
    machine: str = "the robot"

    @property
    def turn_radius_m(self) -> float:
        """Radius of the circle that the footprint sweeps when the robot turns in place."""
        return math.hypot(max(self.front_m, self.rear_m), self.half_width_m)

    @property
    def wheel_turn_radius_m(self) -> float:
        """Radius of the circle that the wheels sweep when the robot turns in place."""
        reach = [math.hypot(abs(x) + self.wheel_radius_m, abs(y) + self.wheel_half_width_m)
                 for x, y in self.wheel_xy_body_m]  # fmt: skip
        return max(reach, default=0.0)


class Leg(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A stretch of the way: points (N, 2) in driving order, at least two.

    The robot turns in place between legs and at the corners of a `link`; along all other kinds
    it bends no tighter than the drive can. A `reverse` leg is driven backwards. `row` numbers the
    working legs, -1 elsewhere.
    """

    kind: LegKind
    xy_map_m: FloatArray
    row: int = -1

    @property
    def tool_on(self) -> bool:
        return self.kind in WORKING

    @property
    def is_reverse(self) -> bool:
        return self.kind == "reverse"

    @property
    def length_m(self) -> float:
        return float(np.sum(np.hypot(*np.diff(self.xy_map_m, axis=0).T)))


class PlanRequest(msgspec.Struct, frozen=True, kw_only=True):
    """Requirements of a field plan.

    `headland_passes` None: as few as do, none with crop rows. `swath_yaw_rad` None: searched for.
    `start` None: the best place to begin.
    """

    implement_width_m: float
    overlap_m: float = 0.05  # overlap of neighbouring swaths, for the error of the steering
    margin_m: float = MARGIN_M  # distance of the footprint from everything that is forbidden
    headland_passes: int | None = None
    swath_yaw_rad: float | None = None
    start_map_m: MapPoint | None = None
    turns: TurnStyle = "auto"
    plant_clearance_m: float = 0.1
    min_coverage_ratio: float = 0.99
    tool_x_m: float = 0.0  # tool point on the body; negative behind the origin

    @property
    def turn_clearance_m(self) -> float:
        """Distance of wheels from crop in turns: the margin of an edge counts there too."""
        return max(self.plant_clearance_m, min(self.margin_m, MOST_CROP_MARGIN_M))

    @property
    def spacing_m(self) -> float:
        return self.implement_width_m - self.overlap_m

    def passes(self, has_rows: bool) -> int:
        """Count the headland passes: a swath can be left until its tool has worked it."""
        if self.headland_passes is not None:
            return self.headland_passes
        if has_rows:
            return 0
        depth_m = abs(self.tool_x_m) - self.overlap_m / 2.0
        return max(1, math.ceil(depth_m / self.spacing_m + 0.5 - 1e-9))


class FieldPlan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Legs that join end to end, and the direction of the swaths."""

    legs: tuple[Leg, ...]
    swath_yaw_rad: float
    warnings: tuple[str, ...] = ()


def measure_footprint(
    robot: RobotSpec, implement_width_m: float, tool_x_m: float | None = None
) -> Footprint:
    """Measure the collision shapes and wheels of the description and the implement.

    The implement works at `tool_x_m`; without it, where the robot's own does.
    """
    tool_x_m = robot.tool_x_m if tool_x_m is None else tool_x_m
    corners = [np.array([[0.0, 0.0, 0.0]])]
    for link in robot.links:
        for shape in link.collisions:
            corners.append(_list_corners(robot.body_from_link(link.name) @ shape.origin.matrix(),
                                          shape.kind, shape.size_m))  # fmt: skip
    points: FloatArray = np.vstack(corners)
    wheels = robot.wheel_xy_body_m()
    radius_m, half_wheel_m = robot.drive.wheel_radius_m, robot.drive.wheel_width_m / 2.0
    across_m = max(
        float(np.abs(points[:, 1]).max()), float(np.abs(wheels[:, 1]).max()) + half_wheel_m
    )
    return Footprint(
        front_m=max(float(points[:, 0].max()), float(wheels[:, 0].max()) + radius_m, tool_x_m),
        rear_m=max(float(-points[:, 0].min()), float(-wheels[:, 0].min()) + radius_m, -tool_x_m),
        half_width_m=max(across_m, implement_width_m / 2.0),
        wheel_xy_body_m=tuple((float(x), float(y)) for x, y in wheels),
        wheel_half_width_m=half_wheel_m,
        wheel_radius_m=radius_m,
        machine=robot.name,
    )


def _list_corners(body_from_shape: FloatArray, kind: str, size_m: tuple[float, ...]) -> FloatArray:
    """Corners of the box around a shape, (8, 3) in the body frame; meshes are not measured."""
    half = {
        "box": (size_m[0] / 2.0, size_m[1] / 2.0, size_m[2] / 2.0),
        "cylinder": (size_m[0], size_m[0], size_m[1] / 2.0),
        "sphere": (size_m[0],) * 3,
    }.get(kind, (0.0, 0.0, 0.0))
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return np.asarray((signs * half) @ body_from_shape[:3, :3].T + body_from_shape[:3, 3])
