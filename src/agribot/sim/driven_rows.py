"""Where a robot truly was in its rows: errors against their lines, and what of them it drove."""

from __future__ import annotations

import math
from collections.abc import Sequence

from agribot.core.geo import wrap_rad
from agribot.core.messages import Row
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.sim.scores import RefereeState

# Distance within which a row counts as driven: farther off, the wheels come near the plants.
KEPT_ROW_M = 0.25
SLICE_M = 0.25  # row length of a slice, for the coverage
SAME_PLACE_M = 0.05  # ends of rows that another plan numbers anew

Ends = tuple[tuple[float, float], tuple[float, float]]


class DrivenRows:
    """Rows as the lines of their plants, by their index; call `judge` inside a row."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self.by_index = {row.index: row for row in rows}
        self.worst_m: dict[int, float] = {}
        self.slices: set[tuple[int, int]] = set()  # row and piece of it, driven within KEPT_ROW_M

    @property
    def rows(self) -> tuple[Row, ...]:
        return tuple(self.by_index.values())

    @property
    def pitch_m(self) -> float:
        """Distance between neighbouring rows; a lone row counts as one metre wide."""
        rows = [self.by_index[index] for index in sorted(self.by_index)]
        if len(rows) < 2:
            return 1.0
        return abs(float(project_on_row(rows[0], *rows[1].start_map_m).left_m))

    def judge(self, row: Row, x_m: float, y_m: float, yaw_rad: float) -> tuple[float, float] | None:
        """Return the errors across the row, m, and of the heading, rad; None beyond its ends."""
        along_m, across_m, row_yaw_rad = map(float, project_on_row(row, x_m, y_m))
        if not 0.0 <= along_m <= row_length_m(row):
            return None
        heading = wrap_rad(yaw_rad - row_yaw_rad)
        if abs(heading) > math.pi / 2:  # driven against the row's direction
            heading = wrap_rad(heading - math.pi)
        self.worst_m[row.index] = max(self.worst_m.get(row.index, 0.0), abs(across_m))
        if abs(across_m) <= KEPT_ROW_M:
            self.slices.add((row.index, _find_slice(row, along_m)))
        return across_m, heading

    def restore(self, before: RefereeState) -> None:
        """Continue the rows of an earlier run that have the same place."""
        for row in before.rows:
            self._restore_row(row, before)

    def _restore_row(self, then: Row, before: RefereeState) -> None:
        """Restore a row where one of the same place exists, of any number and direction."""
        for row in self.by_index.values():
            ends = row.start_map_m, row.end_map_m
            is_same = _is_near(ends, (then.start_map_m, then.end_map_m))
            if not is_same and not _is_near(ends, (then.end_map_m, then.start_map_m)):
                continue
            if then.index in before.worst_m:
                self.worst_m[row.index] = before.worst_m[then.index]
            last = math.ceil(row_length_m(row) / SLICE_M) - 1
            places = [place for index, place in before.slices if index == then.index]
            self.slices |= {(row.index, p if is_same else last - p) for p in places}

    def list_kept(self, rows_done: Sequence[int]) -> tuple[int, ...]:
        """Return those of `rows_done` that the robot truly kept within KEPT_ROW_M."""
        return tuple(row for row in rows_done if self.worst_m.get(row, math.inf) <= KEPT_ROW_M)

    def is_driven(self, row: Row, along_m: float) -> bool:
        """Whether the robot drove past a place along the row, or past its end for one beyond."""
        return (row.index, _find_slice(row, along_m)) in self.slices

    def compute_coverage_ratio(self) -> float:
        """Return the share of all row length that was truly driven within KEPT_ROW_M."""
        total = sum(math.ceil(row_length_m(row) / SLICE_M) for row in self.by_index.values())
        return len(self.slices) / total if total else 0.0


def _is_near(ends: Ends, others: Ends) -> bool:
    return all(math.dist(*pair) <= SAME_PLACE_M for pair in zip(ends, others, strict=True))


def _find_slice(row: Row, along_m: float) -> int:
    """Find the slice of a row, or that of its end, for a place along it or beyond."""
    last = math.ceil(row_length_m(row) / SLICE_M) - 1
    return min(max(int(along_m / SLICE_M), 0), last)
