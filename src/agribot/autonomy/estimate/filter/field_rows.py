"""The field's rows as coordinates: how far along the rows a place lies, and how far across."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from agribot.core.arithmetic import Number, clamp
from agribot.core.config import FieldConfig
from agribot.core.pose import Pose2
from agribot.core.row_shape import project_on_line


class RowFrame(NamedTuple):
    """A place in coordinates of the rows, where these lead there, and the row next to it.

    `forward` and `right` are unit vectors of the map. The row next to the place has the index
    `row`, lies at `row_right_m`, ends at `along_m` = `length_m`, is `stretch` times as long as
    `along_m` counts, and stands `pitch_m` from its neighbour.
    """

    along_m: float
    right_m: float
    yaw_rad: float
    forward: tuple[float, float]
    right: tuple[float, float]
    stretch: float
    row: int
    row_right_m: float
    length_m: float
    pitch_m: float

    @property
    def off_m(self) -> float:
        """Distance of the next row, to the right of the place."""
        return self.row_right_m - self.right_m


class Rows(Protocol):
    """Any rows of crop that the filter may hold against what a camera sees.

    `yaw_rad` is their direction on the whole, `spacing_m` the way from plant to plant.
    """

    yaw_rad: float
    spacing_m: float | None

    @property
    def has_rows(self) -> bool: ...

    def at(self, x_map_m: float, y_map_m: float) -> RowFrame:
        """Resolve a place of the map by the row next to it, whose index is -1 without any row."""
        ...


def find_slot(frame: RowFrame, spacing_m: float) -> tuple[int, float]:
    """Find number and place along the row of the plant nearest to a place of that row."""
    apart_m = spacing_m / frame.stretch
    last = math.floor(frame.length_m / apart_m + 1e-6)
    slot = clamp(round(frame.along_m / apart_m), 0, last)
    return slot, slot * apart_m


class FieldRows:
    """Coordinates of the map along the rows (from their first plant) and to their right.

    Row k lies at `right_m` = k * pitch and reaches from `along_m` = 0 to the row's length; of
    bent rows `along_m` counts on the first one. `forward` and `right` are those of straight rows.
    """

    def __init__(self, field: FieldConfig) -> None:
        yaw_map_rad = math.radians(field.row_yaw_deg)
        self.yaw_rad, self._bend_radpm = yaw_map_rad, field.row_curvature_radpm
        self.forward, self.right = find_axes(yaw_map_rad)
        self.pitch_m = field.row_pitch_m if field.row_count > 1 else math.inf
        self.length_m = field.row_length_m
        self.spacing_m = field.plant_spacing_m
        self._origin_map_m = field.first_row_start_map_m
        self._count = field.row_count

    @property
    def has_rows(self) -> bool:
        return True

    def at(self, x_map_m: float, y_map_m: float) -> RowFrame:
        if not self._bend_radpm:
            along_m, right_m = self.along_right_m(x_map_m, y_map_m)
            return RowFrame(
                along_m, right_m, self.yaw_rad, self.forward, self.right, 1.0,
                *self.row_at(right_m), self.length_m, self.pitch_m,
            )  # fmt: skip
        along_m, left_m, yaw_rad = map(
            float,
            project_on_line(self._origin_map_m, self.yaw_rad, self._bend_radpm, x_map_m, y_map_m),
        )
        row, row_right_m = self.row_at(-left_m)
        stretch = 1.0 + self._bend_radpm * row_right_m
        return RowFrame(
            along_m, -left_m, yaw_rad, *find_axes(yaw_rad), stretch,
            row, row_right_m, self.length_m, self.pitch_m,
        )  # fmt: skip

    def along_right_m(self, x_map_m: Number, y_map_m: Number) -> tuple[Number, Number]:
        """Resolve places (...,) along and to the right of straight rows."""
        dx, dy = x_map_m - self._origin_map_m[0], y_map_m - self._origin_map_m[1]
        forward, right = self.forward, self.right
        return dx * forward[0] + dy * forward[1], dx * right[0] + dy * right[1]

    def row_at(self, right_m: float) -> tuple[int, float]:
        """Find the index of the nearest row, and where it lies."""
        if self._count == 1:
            return 0, 0.0
        row = clamp(round(right_m / self.pitch_m), 0, self._count - 1)
        return row, row * self.pitch_m


def find_axes(yaw_rad: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the unit vectors forward and to the right of a direction."""
    pose = Pose2(0.0, 0.0, yaw_rad)
    return pose.ahead, (pose.sin, -pose.cos)
