"""Where the walkers of a world are, and how near the robot comes to a person."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agribot.core.geo import transform
from agribot.core.messages import FloatArray
from agribot.core.robot import RobotSpec, Shape
from agribot.core.world import Walker, WorldSpec, is_person
from agribot.sim.ground_surface import GroundSurface
from agribot.sim.kernel import sample_grid
from agribot.sim.rigid_body import compute_half_sizes_m
from agribot.sim.underside import build_underside

FAR_M = 5.0  # centres farther apart than the nearest by this are not measured in detail
NEAR_M = 1e-9  # rounding of a distance


class Outline(NamedTuple):
    """A rectangle in plan view, in the axes of its owner: middle and half sizes."""

    x_m: float
    y_m: float
    half_x_m: float
    half_y_m: float


def place_walkers(walkers: Sequence[Walker], ground: GroundSurface, t_s: float) -> list[FloatArray]:
    """Return the pose of each walker in the map at a time, (4, 4), on the ground."""
    if not walkers:
        return []
    grid, poses = ground.make_grid(), []
    for walker in walkers:
        x_m, y_m, yaw_rad = walker.find_place(t_s)
        z_m = sample_grid(grid, x_m, y_m)[0]
        poses.append(transform((x_m, y_m, z_m), (0.0, 0.0, yaw_rad)))
    return poses


def measure_radius_m(shapes: Sequence[Shape]) -> float:
    """Return how far the parts of a figure reach from its place, in plan view."""
    outline = measure_outline(shapes)
    x_m, y_m = abs(outline.x_m) + outline.half_x_m, abs(outline.y_m) + outline.half_y_m
    return math.hypot(x_m, y_m)


def measure_outline(shapes: Sequence[Shape]) -> Outline:
    """Measure the rectangle around shapes, in the axes of their owner."""
    corners = []
    for shape in shapes:
        pose = shape.origin.matrix()
        half_m = np.abs(pose[:2, :3]) @ compute_half_sizes_m(shape)
        corners += [pose[:2, 3] - half_m, pose[:2, 3] + half_m]
    return _make_outline(np.array(corners).reshape(-1, 2))


def measure_robot_outline(robot: RobotSpec) -> Outline:
    """Measure the rectangle around a robot's wheels and collision shapes, in the body frame."""
    drive, under = robot.drive, build_underside(robot)
    half_m = np.array([drive.wheel_radius_m, drive.wheel_width_m / 2.0])
    wheels = robot.wheel_xy_body_m()
    corners = [wheels - half_m, wheels + half_m]
    if np.isfinite(under.clearance_m).any():
        low = np.array([[under.x_min_m, under.y_min_m]])
        corners += [low, low + np.array(under.clearance_m.shape) * under.cell_m]
    return _make_outline(np.concatenate(corners))


def _make_outline(corners: FloatArray) -> Outline:
    low, high = corners.min(axis=0), corners.max(axis=0)
    x_m, y_m = ((low + high) / 2.0).tolist()
    half_x_m, half_y_m = ((high - low) / 2.0).tolist()
    return Outline(x_m, y_m, half_x_m, half_y_m)


class PersonWatch:
    """Track the smallest distance between the robot's outline and a person's; None without one."""

    def __init__(self, robot: RobotSpec, world: WorldSpec) -> None:
        self.least_m: float | None = None
        self._walkers = [walker for walker in world.walkers if is_person(walker.kind)]
        still = [thing for thing in world.obstacles if is_person(thing.kind) and thing.collides]
        self._places = [(thing.x_map_m, thing.y_map_m, thing.yaw_rad) for thing in still]
        shapes = [thing.shapes for thing in still] + [walker.shapes for walker in self._walkers]
        self._outlines = [measure_outline(part) for part in shapes]
        self._own = measure_robot_outline(robot)
        own_m = _measure_reach_m(self._own)
        self._reach_m = [own_m + _measure_reach_m(outline) for outline in self._outlines]

    @property
    def has_persons(self) -> bool:
        return bool(self._outlines)

    def update(self, t_s: float, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Measure with the robot's body at a place in the map."""
        places = [*self._places, *(walker.find_place(t_s) for walker in self._walkers)]
        away_m = [math.hypot(place[0] - x_m, place[1] - y_m) for place in places]
        nearest_m = min(away_m, default=math.inf)
        closer_m = math.inf if self.least_m is None else self.least_m + NEAR_M
        for place, outline, distance_m, reach_m in zip(
            places, self._outlines, away_m, self._reach_m, strict=True
        ):
            if distance_m <= nearest_m + FAR_M and distance_m - reach_m <= closer_m:
                gap_m = measure_gap_m((x_m, y_m, yaw_rad), self._own, place, outline)
                self.least_m = gap_m if self.least_m is None else min(self.least_m, gap_m)


Place = tuple[float, float, float]


def _measure_reach_m(outline: Outline) -> float:
    """Measure how far a rectangle's corners are from its origin at most."""
    return math.hypot(abs(outline.x_m) + outline.half_x_m, abs(outline.y_m) + outline.half_y_m)


def measure_gap_m(place: Place, own: Outline, other: Place, outline: Outline) -> float:
    """Return the distance between two rectangles; two that cross have none.

    Of two convex outlines that are apart, a corner of one is nearest.
    """
    gaps = [
        _measure_corners_m(place, own, other, outline),
        _measure_corners_m(other, outline, place, own),
    ]
    return min(gaps)


def _measure_corners_m(place: Place, own: Outline, other: Place, outline: Outline) -> float:
    """Return the distance of the nearest corner of `outline` from the rectangle `own`."""
    least_m = math.inf
    cos, sin = math.cos(place[2]), math.sin(place[2])
    for x_sign, y_sign in ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        x = outline.x_m + x_sign * outline.half_x_m
        y = outline.y_m + y_sign * outline.half_y_m
        dx = other[0] + math.cos(other[2]) * x - math.sin(other[2]) * y - place[0]
        dy = other[1] + math.sin(other[2]) * x + math.cos(other[2]) * y - place[1]
        beyond_x = max(0.0, abs(dx * cos + dy * sin - own.x_m) - own.half_x_m)
        beyond_y = max(0.0, abs(dy * cos - dx * sin - own.y_m) - own.half_y_m)
        least_m = min(least_m, math.hypot(beyond_x, beyond_y))
    return least_m
