"""What of the rows the tool has worked, as places in the map: it outlives plans and their order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from agribot.core.messages import Row
from agribot.core.row_shape import project_on_row, row_length_m

# A stretch belongs to the row that it lies on, up to the error of a robot that drives it.
BESIDE_M = 0.25
# Longest gap between stretches, and part missing at the ends of a row, m.
GAP_M, MISSING_M = 0.1, 0.2
# Work that goes on overlaps what was worked before.
OVERLAP_M = 0.05


class WorkedStretch(NamedTuple):
    """A worked piece of a row, from one place of the map to another, metres."""

    from_x_m: float
    from_y_m: float
    to_x_m: float
    to_y_m: float


class _Piece(NamedTuple):
    """The same along its row."""

    first_m: float
    last_m: float
    stretch: WorkedStretch


class CoveredRows:
    """Call `work` while the tool works a row, `leave` while it does not."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self._rows = {row.index: row for row in rows}
        self._pieces: dict[int, list[_Piece]] = {row.index: [] for row in rows}
        self._before: dict[int, list[_Piece]] = {row.index: [] for row in rows}
        self._open: int | None = None  # the row whose last piece is growing

    def stretches(self, but: Sequence[int] = ()) -> tuple[WorkedStretch, ...]:
        """List what was worked of all rows but these."""
        return tuple(
            piece.stretch
            for index, pieces in self._pieces.items()
            if index not in but
            for piece in pieces
        )

    def work(self, index: int, x_m: float, y_m: float) -> None:
        """Count a place of the map at which the tool works a row."""
        row = self._rows.get(index)
        if row is None:
            self.leave()
            return
        along_m, pieces = _measure_along_m(row, x_m, y_m), self._pieces[index]
        if self._open != index:
            pieces.append(_Piece(along_m, along_m, WorkedStretch(x_m, y_m, x_m, y_m)))
            self._open = index
        piece = pieces[-1]
        if along_m > piece.last_m:
            stretch = piece.stretch._replace(to_x_m=x_m, to_y_m=y_m)
            pieces[-1] = piece._replace(last_m=along_m, stretch=stretch)
        elif along_m < piece.first_m:
            stretch = piece.stretch._replace(from_x_m=x_m, from_y_m=y_m)
            pieces[-1] = piece._replace(first_m=along_m, stretch=stretch)

    def leave(self) -> None:
        self._open = None

    def restore(self, stretches: Iterable[WorkedStretch]) -> bool:
        """Take over what an earlier mission worked; False if none of it lies on these rows."""
        found = False
        for stretch in stretches:
            for index, row in self._rows.items():
                piece = _place_on_row(row, stretch)
                if piece is not None:
                    self._pieces[index].append(piece)
                    self._before[index].append(piece)
                    found = True
        return found

    def missing_m(self, index: int) -> float:
        """Measure how much of a row has not been worked; small gaps do not count."""
        reached_m = missing_m = 0.0
        for piece in sorted(self._pieces[index]):
            gap_m = piece.first_m - reached_m
            missing_m += gap_m if gap_m > GAP_M else 0.0
            reached_m = max(reached_m, piece.last_m)
        return missing_m + max(row_length_m(self._rows[index]) - reached_m, 0.0)

    @property
    def complete(self) -> tuple[int, ...]:
        """Rows that are worked from end to end."""
        return tuple(index for index in self._rows if self.missing_m(index) <= MISSING_M)

    def was_worked(self, index: int, x_m: float, y_m: float) -> bool:
        """Say whether an earlier mission worked the place of the row beside this one."""
        row = self._rows.get(index)
        if row is None or not self._before[index]:
            return False
        along_m = _measure_along_m(row, x_m, y_m)
        whole_m = row_length_m(row) - GAP_M
        for first_m, last_m, _ in self._before[index]:
            is_behind = along_m >= first_m + OVERLAP_M or first_m <= GAP_M
            if is_behind and (along_m <= last_m - OVERLAP_M or last_m >= whole_m):
                return True
        return False


def cover_row(row: Row) -> WorkedStretch:
    return WorkedStretch(*row.start_map_m, *row.end_map_m)


def _measure_along_m(row: Row, x_m: float, y_m: float) -> float:
    """Within the row: the tool reaches past its ends."""
    return min(max(float(project_on_row(row, x_m, y_m).along_m), 0.0), row_length_m(row))


def _place_on_row(row: Row, stretch: WorkedStretch) -> _Piece | None:
    ends = ((stretch.from_x_m, stretch.from_y_m), (stretch.to_x_m, stretch.to_y_m))
    if any(abs(float(project_on_row(row, *end).left_m)) > BESIDE_M for end in ends):
        return None
    first_m, last_m = sorted(_measure_along_m(row, *end) for end in ends)
    if last_m == first_m and stretch[:2] != stretch[2:]:
        return None  # on the same line, but past the row's end
    return _Piece(first_m, last_m, stretch)
