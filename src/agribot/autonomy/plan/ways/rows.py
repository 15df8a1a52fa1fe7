"""The crop rows of a field, as the planter drilled them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.core.config import FieldConfig
from agribot.core.errors import MissionError
from agribot.core.facts import RowsBent
from agribot.core.messages import MapPoint, Row

SHORTEST_ARC_RATIO = 0.1  # least length of an inner row against the first one


def lay_rows(field: FieldConfig) -> tuple[Row, ...]:
    """Lay the rows in drilling order: each further one lies one pitch to the right.

    Raises: MissionError: the rows are bent too tightly.
    """
    yaw_map_rad, bend_radpm = math.radians(field.row_yaw_deg), field.row_curvature_radpm
    right_x, right_y = math.sin(yaw_map_rad), -math.cos(yaw_map_rad)
    _check_bend(field)
    first_x_m, first_y_m = field.first_row_start_map_m
    rows = []
    for index in range(field.row_count):
        offset_m = index * field.row_pitch_m
        stretch = 1.0 + bend_radpm * offset_m  # length of the arc against that of the first row
        half_turn_rad = bend_radpm * field.row_length_m / 2.0
        ratio = math.sin(half_turn_rad) / half_turn_rad if half_turn_rad else 1.0
        chord_m = field.row_length_m * stretch * ratio
        chord_yaw_rad = yaw_map_rad + half_turn_rad
        x_m, y_m = first_x_m + offset_m * right_x, first_y_m + offset_m * right_y
        end = (
            x_m + chord_m * math.cos(chord_yaw_rad),
            y_m + chord_m * math.sin(chord_yaw_rad),
        )
        rows.append(
            Row(
                index=index,
                start_map_m=(x_m, y_m),
                end_map_m=end,
                curvature_radpm=bend_radpm / stretch,
            )
        )
    return tuple(rows)


def list_row_ends(rows: Sequence[Row]) -> tuple[MapPoint, ...]:
    """List both ends of every row, the goals that a map shows for a mission over rows."""
    return tuple(end for row in rows for end in (row.start_map_m, row.end_map_m))


def _check_bend(field: FieldConfig) -> None:
    bend_radpm = field.row_curvature_radpm
    turn_rad = abs(bend_radpm) * field.row_length_m
    narrowest = 1.0 + bend_radpm * (field.row_count - 1) * field.row_pitch_m
    if turn_rad >= math.pi or narrowest < SHORTEST_ARC_RATIO:
        raise MissionError(RowsBent(bend_radpm, turn_rad, narrowest, SHORTEST_ARC_RATIO))
