"""The rectangle that a robot with its implement covers, measured from its description."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.core.messages import FloatArray, MapPoint
from agribot.core.robot import RobotSpec


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
