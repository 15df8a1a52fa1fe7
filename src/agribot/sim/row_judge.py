"""Rows that a robot found, held against those that truly stand there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from agribot.core.messages import FloatArray, MapPoint, Row
from agribot.core.pose import Pose2
from agribot.core.row_shape import (
    project_on_row,
    row_length_m,
    row_points_map_m,
    start_yaw_rad,
)

# Largest distance of a found row's middle and both ends from the line of its true row.
SAME_ROW_M = 0.3
# Largest distance of crop from a drawn row, and then from the line of that crop.
CROP_OF_ROW_M = (0.4, 0.25, 0.15)
LEAST_PLANTS = 3


class FoundRowsScore(msgspec.Struct, frozen=True, kw_only=True):
    """Count of found rows, of all rows, and their error; None where nothing was measured.

    `invented` are found rows where none stands, or where one was found already. Offsets are
    across a true row at both ends and in the middle of the found one, `end_error_m_max` is along
    it.
    """

    found: int
    true: int
    matched: int
    invented: int
    offset_rms_m: float | None = None
    offset_m_max: float | None = None
    end_error_m_max: float | None = None


def find_true_row(row: Row, true_rows: Sequence[Row]) -> Row | None:
    """Find the true row on which a found one lies."""
    near = [(_measure_off_m(row, true).max(), true) for true in true_rows]
    off_m, true = min(near, key=lambda pair: float(pair[0]), default=(np.inf, None))
    return true if off_m <= SAME_ROW_M else None


def lay_through_crop(row: Row, crop_xy_m: FloatArray) -> Row:
    """Lay a straight row that somebody drew through the crop, (N, 2), that stands about it.

    It runs from the first plant to the last, as far as it was drawn. A row without crop, and one
    that bends, stays as it was drawn.
    """
    if row.curvature_radpm or not len(crop_xy_m):
        return row
    for reach_m in CROP_OF_ROW_M:
        along_m, left_m, _ = project_on_row(row, crop_xy_m[:, 0], crop_xy_m[:, 1])
        length_m = row_length_m(row)
        is_near = (np.abs(left_m) < reach_m) & (along_m > -reach_m) & (along_m < length_m + reach_m)
        if np.count_nonzero(is_near) < LEAST_PLANTS or np.ptp(along_m[is_near]) < reach_m:
            return row
        slope, begin_m = np.polyfit(along_m[is_near], left_m[is_near], 1)
        ends_m = np.clip((along_m[is_near].min(), along_m[is_near].max()), 0.0, length_m).tolist()
        line = Pose2(*row.start_map_m, start_yaw_rad(row))
        start, end = (line.transform(end_m, float(begin_m + slope * end_m)) for end_m in ends_m)
        row = msgspec.structs.replace(row, start_map_m=start, end_map_m=end)
    return row


def shift_row(row: Row, by_m: MapPoint) -> Row:
    """Move a row."""
    (x0, y0), (x1, y1), (dx, dy) = row.start_map_m, row.end_map_m, by_m
    return msgspec.structs.replace(
        row, start_map_m=(x0 + dx, y0 + dy), end_map_m=(x1 + dx, y1 + dy)
    )


def score_found_rows(
    found: Sequence[Row], true_rows: Sequence[Row], matches: Mapping[int, Row]
) -> FoundRowsScore:
    """Hold found rows against true ones, each against one, and measure how far off they are.

    `matches` has for the number of each found row the true one that was found, or no true one.
    """
    taken: dict[int, Row] = {}
    for row in found:
        true = matches.get(row.index)
        if true in true_rows and true is not None and true.index not in taken:
            taken[true.index] = row
    pairs = [(taken[true.index], true) for true in true_rows if true.index in taken]
    off_m = np.array([_measure_off_m(row, true) for row, true in pairs]).ravel()
    ends_m = [_measure_end_error_m(row, true) for row, true in pairs]
    return FoundRowsScore(
        found=len(found), true=len(true_rows), matched=len(pairs), invented=len(found) - len(pairs),
        offset_rms_m=float(np.sqrt(np.mean(off_m**2))) if len(off_m) else None,
        offset_m_max=float(off_m.max()) if len(off_m) else None,
        end_error_m_max=max(ends_m, default=None),
    )  # fmt: skip


def _measure_off_m(row: Row, true: Row) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    points = row_points_map_m(row)
    middle = (points[0] + points[-1]) / 2.0 if len(points) == 2 else points[len(points) // 2]
    places = np.stack([points[0], middle, points[-1]])
    along_m, left_m, _ = project_on_row(true, places[:, 0], places[:, 1])
    past_m = np.maximum(np.maximum(-along_m, along_m - row_length_m(true)), 0.0)
    return np.asarray(np.where(past_m > row_length_m(true), np.inf, np.abs(left_m)))


def _measure_end_error_m(row: Row, true: Row) -> float:
    ends_m = sorted(
        float(project_on_row(true, *end).along_m) for end in (row.start_map_m, row.end_map_m)
    )
    return max(abs(ends_m[0]), abs(ends_m[1] - row_length_m(true)))
