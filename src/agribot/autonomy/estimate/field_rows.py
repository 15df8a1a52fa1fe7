"""The field's rows as coordinates: how far along the rows a place lies, and how far across."""

from __future__ import annotations

import math
from typing import NamedTuple

from agribot.core.arithmetic import Number, clamp
from agribot.core.config import FieldConfig
from agribot.core.pose import Pose2
from agribot.core.row_shape import project_on_line


class RowPlace(NamedTuple):
    """A place of a row that a plant may stand on; `slot` is None where the spacing is unknown."""

    row: int
    slot: int | None
    along_m: float
    right_m: float


class RowFrame(NamedTuple):
    """A place in coordinates of the rows, and where these lead there.

    `forward` and `right` are unit vectors of the map. The row next to the place is `stretch`
    times as long as `along_m` counts.
    """

    along_m: float
    right_m: float
    yaw_rad: float
    forward: tuple[float, float]
    right: tuple[float, float]
    stretch: float


class FieldRows:
    """Coordinates of the map along the rows (from their first plant) and to their right.

    Row k lies at `right_m` = k * pitch and reaches from `along_m` = 0 to the row's length; of
    bent rows `along_m` counts on the first one. `forward` and `right` are those of straight rows.
    """

    def __init__(self, field: FieldConfig) -> None:
        yaw_map_rad = math.radians(field.row_yaw_deg)
        self._yaw_map_rad, self._bend_radpm = yaw_map_rad, field.row_curvature_radpm
        self.forward, self.right = _axes(yaw_map_rad)
        self.pitch_m = field.row_pitch_m if field.row_count > 1 else math.inf
        self.length_m = field.row_length_m
        self.spacing_m = field.plant_spacing_m
        self._origin_map_m = field.first_row_start_map_m
        self._count = field.row_count

    def at(self, x_map_m: float, y_map_m: float) -> RowFrame:
        if not self._bend_radpm:
            along_m, right_m = self.along_right_m(x_map_m, y_map_m)
            return RowFrame(along_m, right_m, self._yaw_map_rad, self.forward, self.right, 1.0)
        along_m, left_m, yaw_rad = map(
            float,
            project_on_line(
                self._origin_map_m, self._yaw_map_rad, self._bend_radpm, x_map_m, y_map_m
            ),
        )
        _, row_right_m = self.row_at(-left_m)
        stretch = 1.0 + self._bend_radpm * row_right_m
        return RowFrame(along_m, -left_m, yaw_rad, *_axes(yaw_rad), stretch)

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

    def slot_at(self, along_m: float, stretch: float) -> tuple[int, float] | None:
        """Find number and place of the nearest plant of a row; None without a known spacing."""
        if self.spacing_m is None:
            return None
        spacing_m = self.spacing_m / stretch
        last = math.floor(self.length_m / spacing_m + 1e-6)
        slot = clamp(round(along_m / spacing_m), 0, last)
        return slot, slot * spacing_m


def _axes(yaw_rad: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the unit vectors forward and to the right of a direction."""
    pose = Pose2(0.0, 0.0, yaw_rad)
    return pose.ahead, (pose.sin, -pose.cos)
