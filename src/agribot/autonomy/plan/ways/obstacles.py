"""What stands in a field and must not be touched: circles, as of posts, and areas of a map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agribot.autonomy.plan.ways.footprint import Footprint, measure_footprint
from agribot.autonomy.plan.ways.keep_out import KeepOut
from agribot.core.errors import MissionError
from agribot.core.facts import NearKeptOut, NearObstacle
from agribot.core.keep_out import BodyBox
from agribot.core.messages import FloatArray, MapPoint, Path
from agribot.core.robot import RobotSpec

_EVERY, _TOUCH_M = 5, 1e-6  # points of a path, 10 cm; what is no nearness
_BEYOND_M = 0.05  # margin of a way around, beyond the clearance: curves cut its corners


class ObstacleCircle(NamedTuple):
    x_m: float
    y_m: float
    radius_m: float


class Obstacles(NamedTuple):
    """The robot's `body` keeps `clearance_m` off each of `circles` and off the areas."""

    circles: tuple[ObstacleCircle, ...] = ()
    clearance_m: float = 0.0
    body: Footprint = Footprint(front_m=0.0, rear_m=0.0, half_width_m=0.0)
    areas: KeepOut | None = None

    @property
    def are_none(self) -> bool:
        return not self.circles and self.areas is None

    def are_clear_of(self, path: Path) -> bool:
        return self._closest(path)[0] >= self.clearance_m and self._find_area(path) is None

    def check(self, path: Path) -> None:
        """Refuse a path that comes too close. Raises: MissionError: and where it does."""
        away_m, point, index = self._closest(path)
        if away_m >= self.clearance_m:
            self._check_areas(path)
            return
        circle, (east_m, north_m) = self.circles[index], path.xy_map_m[point]
        raise MissionError(
            NearObstacle(
                float(east_m), float(north_m), max(away_m, 0.0), circle.x_m, circle.y_m,
                self.clearance_m,
            )
        )  # fmt: skip

    def rings(self) -> list[list[tuple[float, float]]]:
        """List the corners of a square around each, counter-clockwise, that the robot can drive."""
        found = []
        for x_m, y_m, radius_m in self.circles:
            half_m = radius_m + self.clearance_m + self.body.half_width_m + _BEYOND_M
            signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
            found.append([(x_m + half_m * east, y_m + half_m * north) for east, north in signs])
        if self.areas is not None:
            away_m = self.clearance_m + self.body.half_width_m + _BEYOND_M
            found += self.areas.list_rings_around(away_m)
        return found

    def _check_areas(self, path: Path) -> None:
        found = self._find_area(path)
        if found is None:
            return
        point, away_m, place = found
        raise MissionError(NearKeptOut(*point, away_m, *place, self.clearance_m))

    def _find_area(self, path: Path) -> tuple[MapPoint, float, MapPoint] | None:
        """Find the first place too near to an area, the distance, and a place of that area."""
        if self.areas is None:
            return None
        poses = thin_poses(path)
        body = BodyBox(self.body.front_m, self.body.rear_m, self.body.half_width_m)
        touch = self.areas.find_touch(poses, body, self.clearance_m - _TOUCH_M)
        if touch is None:
            return None
        east_m, north_m, _ = poses[touch.pose].tolist()
        return (east_m, north_m), touch.away_m, touch.place_map_m

    def _closest(self, path: Path) -> tuple[float, int, int]:
        """Distance of the body's rectangle, at which point of the path, from which obstacle."""
        if not self.circles:
            return math.inf, -1, -1
        x_m, y_m, radius_m = np.array(self.circles).T
        cos, sin = np.cos(path.yaw_map_rad)[:, None], np.sin(path.yaw_map_rad)[:, None]
        east_m, north_m = x_m - path.xy_map_m[:, :1], y_m - path.xy_map_m[:, 1:]
        ahead_m, left_m = cos * east_m + sin * north_m, cos * north_m - sin * east_m
        past_m = np.maximum(ahead_m - self.body.front_m, -ahead_m - self.body.rear_m)
        beside_m = np.abs(left_m) - self.body.half_width_m
        away_m = np.hypot(np.maximum(past_m, 0.0), np.maximum(beside_m, 0.0)) - radius_m
        point, index = np.unravel_index(np.argmin(away_m), away_m.shape)
        return float(away_m[point, index]), int(point), int(index)


def thin_poses(path: Path) -> FloatArray:
    """Return every fifth pose of a path and the last one, (n, 3): East, North and yaw."""
    poses = np.column_stack([path.xy_map_m, path.yaw_map_rad])
    return np.concatenate([poses[::_EVERY], poses[-1:]])


NO_OBSTACLES = Obstacles()


def make_obstacles(
    circles: Sequence[tuple[float, float, float]],
    clearance_m: float,
    robot: RobotSpec,
    rings_map_m: Sequence[Sequence[MapPoint]] = (),
) -> Obstacles:
    """Make obstacles of circles, East, North and radius, and of the corners of areas, metres."""
    return Obstacles(
        tuple(ObstacleCircle(*circle) for circle in circles),
        clearance_m,
        measure_footprint(robot, 0.0),
        KeepOut(rings_map_m) if rings_map_m else None,
    )
