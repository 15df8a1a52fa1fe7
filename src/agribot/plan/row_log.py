"""Which rows were worked, how far, and which were left out on purpose."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec


class RowResult(msgspec.Struct, frozen=True, kw_only=True):
    """One row as the robot believes it went; times are None where it did not come so far.

    `worked_m` is how much of the row, from the end where the work began, is behind the tool.
    """

    index: int
    started_s: float | None = None
    finished_s: float | None = None
    done: bool = False
    skipped: bool = False
    worked_m: float = 0.0
    max_cross_track_m: float = 0.0


class RowLog:
    """Rows by number; `here` is the one under the robot, or -1."""

    def __init__(self, indices: Iterable[int]) -> None:
        self._results = {index: RowResult(index=index) for index in indices}
        self.here = -1
        self._entered_m = 0.0
        self.done: tuple[int, ...] = ()

    @property
    def results(self) -> tuple[RowResult, ...]:
        return tuple(self._results.values())

    @property
    def indices(self) -> tuple[int, ...]:
        return tuple(self._results)

    @property
    def skipped(self) -> tuple[int, ...]:
        return tuple(index for index, result in self._results.items() if result.skipped)

    def restore(self, results: Sequence[RowResult], here: int, s_m: float) -> None:
        self._results.update({result.index: result for result in results})
        self.done = tuple(
            result.index
            for result in sorted(results, key=lambda result: result.finished_s or 0.0)
            if result.done
        )
        self.here = here
        self._entered_m = s_m - self._results[here].worked_m if here >= 0 else s_m

    def work(self, row: int, beside_m: float, s_m: float, t_s: float) -> None:
        """The robot is in a row, or in none (-1), at `s_m` along its path."""
        if row != self.here and self.here >= 0 and not self._results[self.here].skipped:
            if not self._results[self.here].done:
                self.done += (self.here,)
            self._change(self.here, finished_s=t_s, done=True)
        if row >= 0:
            before = self._results[row]
            if row != self.here:
                self._entered_m = s_m
                self._change(row, started_s=t_s)
            if not before.skipped:
                worst_m = max(before.max_cross_track_m, beside_m)
                self._change(row, worked_m=s_m - self._entered_m, max_cross_track_m=worst_m)
        self.here = row

    def take_as_done(self, row: int) -> None:
        """An earlier mission has worked it whole."""
        self._change(row, done=True)
        self.done += (row,)

    def leave(self) -> None:
        """The row under the robot is not finished; it will be entered again."""
        self.here = -1

    def skip(self, row: int) -> None:
        if row in self._results and not self._results[row].done:
            self._change(row, skipped=True)

    def is_skipped(self, row: int) -> bool:
        return row in self._results and self._results[row].skipped

    def open_rows(self, planned: Iterable[int]) -> list[int]:
        """Planned rows that are neither done nor skipped."""
        return [
            row for row in planned if not (self._results[row].done or self._results[row].skipped)
        ]

    def _change(self, row: int, **changes: float | bool) -> None:
        self._results[row] = msgspec.structs.replace(self._results[row], **changes)
