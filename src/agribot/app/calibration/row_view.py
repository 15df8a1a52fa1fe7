"""Whether the camera sees the rows where they stand: its row lines against poses of GNSS."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from agribot.autonomy.estimate.filter.field_rows import FieldRows
from agribot.autonomy.estimate.sensors.row_lines import MAX_HEADING_RAD
from agribot.core.config import FieldConfig
from agribot.core.errors import MissionError
from agribot.core.facts import NoRowLine
from agribot.core.geo import wrap_rad
from agribot.core.messages import RowLine

MIN_LINES, MIN_SEEN_RATIO = 40, 0.5
MAX_POSE_STD_M = 0.03
# Largest offset from a row's middle; on the other side of it the robot sees another row.
MAX_OFFSET_RATIO = 0.3
# Neighbouring pictures that count as one, since they show the same leaves.
PICTURES_ALIKE = 10
MAX_OFFSET_BIAS_M, MAX_HEADING_BIAS_RAD = 0.02, math.radians(0.7)
NORMAL_MAD = 1.4826


class Glance(NamedTuple):
    """A picture: the pose of the body in the map without it, its row line, and the pose's stds."""

    pose_map: tuple[float, float, float]
    line: RowLine | None
    pos_std_m: float
    yaw_std_rad: float


class RowViewFit(msgspec.Struct, frozen=True, kw_only=True):
    """Row lines less the truth as GNSS has it: median, its 1 sigma, scatter, and what is stated.

    The offset is positive where the camera sees the robot too far left of its row.
    """

    pictures: int
    lines: int
    pose_std_m: float
    offset_bias_m: float
    offset_bias_std_m: float
    offset_scatter_m: float
    offset_stated_m: float
    heading_bias_rad: float
    heading_bias_std_rad: float
    heading_scatter_rad: float
    heading_stated_rad: float

    def complaints(self) -> tuple[str, ...]:
        found = []
        if self.lines < MIN_LINES:
            found.append(f"only {self.lines} row lines, {MIN_LINES} are needed; drive further")
        if self.lines < MIN_SEEN_RATIO * self.pictures:
            found.append(
                f"a row line in {self.lines / self.pictures:.0%} of the pictures, at least "
                f"{MIN_SEEN_RATIO:.0%} are needed; lines want plants up to half a metre apart"
            )
        if self.pose_std_m > MAX_POSE_STD_M:
            found.append(
                f"the pose is known to {100 * self.pose_std_m:.0f} cm only, "
                f"{100 * MAX_POSE_STD_M:.0f} are needed; use a receiver with corrections"
            )
        if abs(self.offset_bias_m) > MAX_OFFSET_BIAS_M + 2.0 * self.offset_bias_std_m:
            found.append(
                f"rows are seen {100 * self.offset_bias_m:+.1f} cm aside, at most "
                f"{100 * MAX_OFFSET_BIAS_M:.0f} will do; run agribot calibrate camera, or measure "
                "the field's rows again"
            )
        if abs(self.heading_bias_rad) > MAX_HEADING_BIAS_RAD + 2.0 * self.heading_bias_std_rad:
            found.append(
                f"rows are seen turned by {math.degrees(self.heading_bias_rad):+.1f} degrees, at "
                f"most {math.degrees(MAX_HEADING_BIAS_RAD):.1f} will do; run agribot calibrate "
                "camera"
            )
        return tuple(found)


def fit_row_view(glances: Sequence[Glance], field: FieldConfig) -> RowViewFit:
    """Compare the row lines of pictures with the poses at which they were taken.

    Raises: MissionError: no picture was taken inside a row, or none shows a line.
    """
    rows = FieldRows(field)
    errors, stated, stds, pictures = [], [], [], 0
    for glance in glances:
        if not _is_inside(glance, rows):
            continue
        pictures += 1
        error = _error(glance, rows)
        if error is not None and glance.line is not None:
            errors.append(error)
            stated.append((glance.line.offset_std_m, glance.line.heading_std_rad))
            stds.append(glance.pos_std_m)
    if not errors:
        raise MissionError(NoRowLine(pictures, len(glances)))
    table = np.array(errors)
    bias = np.median(table, axis=0)
    scatter = NORMAL_MAD * np.median(np.abs(table - bias), axis=0)
    std = scatter * math.sqrt(min(PICTURES_ALIKE / len(table), 1.0))
    said = np.median(np.array(stated), axis=0)
    return RowViewFit(
        pictures=pictures, lines=len(table), pose_std_m=float(np.median(stds)),
        offset_bias_m=float(bias[0]), offset_bias_std_m=float(std[0]),
        offset_scatter_m=float(scatter[0]), offset_stated_m=float(said[0]),
        heading_bias_rad=float(bias[1]), heading_bias_std_rad=float(std[1]),
        heading_scatter_rad=float(scatter[1]), heading_stated_rad=float(said[1]),
    )  # fmt: skip


def _is_inside(glance: Glance, rows: FieldRows) -> bool:
    x_m, y_m, yaw_rad = glance.pose_map
    frame = rows.at(x_m, y_m)
    _, right_m = rows.row_at(frame.right_m)
    aslant_rad = abs(math.remainder(yaw_rad - frame.yaw_rad, math.pi))
    is_beside = abs(right_m - frame.right_m) < MAX_OFFSET_RATIO * rows.pitch_m
    return is_beside and aslant_rad < MAX_HEADING_RAD / 2.0 and 0.0 < frame.along_m < rows.length_m


def _error(glance: Glance, rows: FieldRows) -> tuple[float, float] | None:
    """Errors of offset and heading."""
    line = glance.line
    if line is None or line.offset_m is None or line.heading_rad is None:
        return None
    x_m, y_m, yaw_rad = glance.pose_map
    ahead_m = line.at_ahead_m
    frame = rows.at(x_m + ahead_m * math.cos(yaw_rad), y_m + ahead_m * math.sin(yaw_rad))
    _, right_m = rows.row_at(frame.right_m)
    sign = 1.0 if math.cos(yaw_rad - frame.yaw_rad) >= 0.0 else -1.0
    heading_rad = wrap_rad(yaw_rad - frame.yaw_rad + (0.0 if sign > 0.0 else math.pi))
    offset_m = sign * (right_m - frame.right_m)
    return line.offset_m - offset_m, wrap_rad(line.heading_rad - heading_rad)
