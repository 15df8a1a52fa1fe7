"""A place and a heading in the plane: the one place where 2-D rotations are written out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from agribot.core.arithmetic import Number
from agribot.core.geo import wrap_rad


@dataclass(frozen=True, slots=True)
class Pose2:
    """Pose of a frame in its parent: x and y, and the turn.

    Yaw is counter-clockwise. The pose `map_from_body` leads from body to map: its x axis points
    ahead, its y axis to the left. Points may be floats or arrays of one shape.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    cos: float = field(init=False, repr=False, compare=False)
    sin: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cos", math.cos(self.yaw_rad))
        object.__setattr__(self, "sin", math.sin(self.yaw_rad))

    @property
    def xy_m(self) -> tuple[float, float]:
        """Position in the parent."""
        return self.x_m, self.y_m

    @property
    def ahead(self) -> tuple[float, float]:
        """Unit vector of the heading, in the parent."""
        return self.cos, self.sin

    @property
    def left(self) -> tuple[float, float]:
        """Unit vector to the left of the heading, in the parent."""
        return -self.sin, self.cos

    def rotate(self, ahead_m: Number, left_m: Number | float) -> tuple[Number, Number]:
        """Turn a vector of this frame into the parent's axes."""
        return (
            self.cos * ahead_m - self.sin * left_m,
            self.sin * ahead_m + self.cos * left_m,
        )

    def resolve(self, dx_m: Number, dy_m: Number | float) -> tuple[Number, Number]:
        """Resolve a vector of the parent into its parts ahead and to the left."""
        return self.cos * dx_m + self.sin * dy_m, self.cos * dy_m - self.sin * dx_m

    def transform(self, ahead_m: Number, left_m: Number | float) -> tuple[Number, Number]:
        """Transform a point of this frame into the parent."""
        return (
            self.x_m + self.cos * ahead_m - self.sin * left_m,
            self.y_m + self.sin * ahead_m + self.cos * left_m,
        )

    def locate(self, x_m: Number, y_m: Number) -> tuple[Number, Number]:
        """Say how far ahead and to the left a point of the parent lies."""
        return self.resolve(x_m - self.x_m, y_m - self.y_m)

    def compose(self, child: Pose2) -> Pose2:
        """Chain `map_from_body` and `body_from_tool` to `map_from_tool`."""
        return Pose2(*self.transform(child.x_m, child.y_m), wrap_rad(self.yaw_rad + child.yaw_rad))

    def inverse(self) -> Pose2:
        """Turn `map_from_body` into `body_from_map`."""
        return Pose2(*self.locate(0.0, 0.0), wrap_rad(-self.yaw_rad))
