"""What of the robot must not enter which ground, for those who plan and those who guard."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from agribot.core.messages import FloatArray


class BodyBox(NamedTuple):
    """A rectangle in the body frame; all numbers are distances from its origin, the sides alike."""

    front_m: float
    rear_m: float
    half_width_m: float


class AreaTouch(NamedTuple):
    """Pose that comes nearest to an area, the distance, and a place of that area."""

    pose: int
    away_m: float
    place_map_m: tuple[float, float]


class KeepOutAreas(Protocol):
    """Areas that no part of the robot may enter."""

    def find_touch(self, poses: FloatArray, body: BodyBox, within_m: float) -> AreaTouch | None:
        """Find where a body comes nearest, of `poses` (N, 3) that come nearer than `within_m`."""
        ...
