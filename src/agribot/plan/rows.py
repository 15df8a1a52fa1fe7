"""The crop rows of a field, as the planter drilled them."""

from __future__ import annotations

import math

from agribot.config import FieldConfig
from agribot.messages import Row


def field_rows(field: FieldConfig) -> tuple[Row, ...]:
    """Rows in drilling order: each further one lies one pitch to the right."""
    yaw_map_rad = math.radians(field.row_yaw_deg)
    forward_x, forward_y = math.cos(yaw_map_rad), math.sin(yaw_map_rad)
    right_x, right_y = forward_y, -forward_x
    first_x_m, first_y_m = field.first_row_start_map_m
    rows = []
    for index in range(field.row_count):
        offset_m = index * field.row_pitch_m
        x_m, y_m = first_x_m + offset_m * right_x, first_y_m + offset_m * right_y
        end = (x_m + field.row_length_m * forward_x, y_m + field.row_length_m * forward_y)
        rows.append(Row(index=index, start_map_m=(x_m, y_m), end_map_m=end))
    return tuple(rows)
