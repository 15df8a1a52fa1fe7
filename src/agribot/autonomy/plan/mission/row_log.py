"""Which rows were worked, how far, and which were left out on purpose."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import msgspec

from agribot.core.facts import RowUnproven

Doubt = Literal["", "unseen", "unsure"]
# Largest share of the driven length without proof; gaps in the crop and weak light may take it.
UNPROVEN_RATIO = 0.5
# Share of its length unseen from which a row is bare ground: an earlier sight lasts for some
# distance.
BARE_RATIO = 0.8
# Most that a person may move the line of a row aside; the packaged robot's wheels clear 0.3 m.
MOST_NUDGED_M = 0.1


class RowResult(msgspec.Struct, frozen=True, kw_only=True):
    """One row as the robot believes it went; times are None where it did not get there.

    `worked_m` is how much of the row, from the end where the work began, is behind the tool;
    over `unseen_m` of that a camera saw no crop where the row is to be, over `unsure_m` the
    position could not separate the row from the next. If this is the larger part of a row, it is
    `unproven` and not done. Its line was moved by hand `nudged_m` to its left. Over `counted_m`
    only the rows before identified it.
    """

    index: int
    started_s: float | None = None
    finished_s: float | None = None
    done: bool = False
    skipped: bool = False
    worked_m: float = 0.0
    max_cross_track_m: float = 0.0
    unseen_m: float = 0.0
    unsure_m: float = 0.0
    counted_m: float = 0.0
    nudged_m: float = 0.0
    unproven: bool = False

    @property
    def is_counted(self) -> bool:
        return self.counted_m > UNPROVEN_RATIO * self.worked_m

    @property
    def is_bare(self) -> bool:
        return 0.0 < BARE_RATIO * self.worked_m <= self.unseen_m

    @property
    def objection(self) -> RowUnproven:
        """What speaks against the row."""
        if has_evidence([self]):
            return RowUnproven(self.index + 1)
        return RowUnproven(self.index + 1, self.unseen_m, self.unsure_m)


def has_evidence(stretches: Sequence[RowResult]) -> bool:
    """Say whether a row, in one stretch or several, was seen or known over most of its length."""
    doubted_m = sum(stretch.unseen_m + stretch.unsure_m for stretch in stretches)
    return doubted_m <= UNPROVEN_RATIO * sum(stretch.worked_m for stretch in stretches)


class RowLog:
    """Rows by number; `here` is the one under the robot, or -1."""

    def __init__(self, indices: Iterable[int], go_on: Mapping[int, int] | None = None) -> None:
        """`go_on` has for a stretch of a bent row the number of the next one."""
        self._results = {index: RowResult(index=index) for index in indices}
        self._go_on = dict(go_on or {})
        # Stretches of a bent row, and whether each was done before.
        self._behind: list[tuple[int, bool]] = []
        self.here = -1
        self._entered_m = self._last_m = 0.0
        self.done: tuple[int, ...] = ()
        self.unproven: tuple[int, ...] = ()

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
        self.unproven = tuple(result.index for result in results if result.unproven)
        self.here = here
        self._entered_m = s_m - self._results[here].worked_m if here >= 0 else s_m
        self._last_m = s_m

    def work(
        self,
        row: int,
        beside_m: float,
        s_m: float,
        t_s: float,
        doubt: Doubt = "",
        *,
        is_counted: bool = False,
    ) -> None:
        """Count the robot in a row, or in none (-1), at `s_m` along its path.

        `doubt` says what speaks against being in that row; `is_counted` that only the rows before
        it identify it.
        """
        if row != self.here and self.here >= 0 and not self._results[self.here].skipped:
            self._finish(self.here, t_s)
        if row >= 0:
            if row != self.here:
                self._entered_m = self._last_m = s_m
                self._change(
                    row, started_s=t_s, unseen_m=0.0, unsure_m=0.0, counted_m=0.0, unproven=False
                )
            before = self._results[row]
            if not before.skipped:
                step_m = s_m - self._last_m
                self._change(
                    row,
                    worked_m=s_m - self._entered_m,
                    max_cross_track_m=max(before.max_cross_track_m, beside_m),
                    unseen_m=before.unseen_m + step_m * (doubt == "unseen"),
                    unsure_m=before.unsure_m + step_m * (doubt == "unsure"),
                    counted_m=before.counted_m + step_m * (is_counted and not before.done),
                )
        self.here, self._last_m = row, s_m

    def _finish(self, row: int, t_s: float) -> None:
        """End a row, or a stretch of a bent one, which counts as done until all of it is driven."""
        if not self._behind or self._go_on.get(self._behind[-1][0]) != row:
            self._behind = []
        self._behind.append((row, self._results[row].done))
        self._change(row, finished_s=t_s)
        following = self._go_on.get(row)
        if following is not None and not self._results[following].skipped:
            self._settle(row, is_done=True)
            return
        is_proven = has_evidence([self._results[stretch] for stretch, _ in self._behind])
        for stretch, was_done in self._behind:
            self._settle(stretch, is_done=is_proven or was_done)
        self._doubt_count()

    def _settle(self, row: int, *, is_done: bool) -> None:
        self.unproven = tuple(index for index in self.unproven if index != row)
        if not is_done:
            self.done = tuple(index for index in self.done if index != row)
            self.unproven += (row,)
        elif row not in self.done:
            self.done += (row,)
        self._change(row, done=is_done, unproven=not is_done)

    def _doubt_count(self) -> None:
        """Take bare ground for a row as a wrong count: no row identified by it is proven."""
        counted = [result for result in self._results.values() if result.is_counted]
        if not any(result.is_bare and result.unproven for result in counted):
            return
        doubted = [result.index for result in counted if result.done]
        for index in doubted:
            self._change(index, done=False, unproven=True)
        self.done = tuple(index for index in self.done if index not in doubted)
        self.unproven += tuple(doubted)

    def give_up(self, length_m: float) -> None:
        """Judge the row of that length under the robot, which gets no farther in it.

        Where the larger part of it is bare ground, the count of rows is wrong as at its end.
        """
        here = self._results.get(self.here)
        if here is not None and here.is_bare and here.worked_m > UNPROVEN_RATIO * length_m:
            self._settle(self.here, is_done=False)
            self._doubt_count()

    def object_to(self, row: int) -> RowUnproven:
        """Return what speaks against an unproven row."""
        return self._results[row].objection

    def nudge(self, row: int, left_m: float) -> bool:
        """Move the line of a row aside, to the left of its direction; False beyond the limit."""
        nudged_m = self._results[row].nudged_m + left_m
        if abs(nudged_m) > MOST_NUDGED_M + 1e-9:
            return False
        self._change(row, nudged_m=nudged_m)
        return True

    def nudged_m(self, row: int) -> float:
        return self._results[row].nudged_m if row in self._results else 0.0

    def keep(self, indices: Iterable[int]) -> None:
        """Go over to other rows: what is known of those that stay is kept."""
        before = self._results
        self._results = {index: before.get(index, RowResult(index=index)) for index in indices}
        self.done = tuple(index for index in self.done if index in self._results)
        self.unproven = tuple(index for index in self.unproven if index in self._results)
        self.here = self.here if self.here in self._results else -1

    def take_as_done(self, row: int) -> None:
        """Count a row as done that an earlier mission has worked whole."""
        self._change(row, done=True)
        self.done += (row,)

    def leave(self) -> None:
        """Leave the row under the robot unfinished; it will be entered again."""
        self.here = -1

    def skip(self, row: int) -> None:
        if row in self._results and not self._results[row].done:
            self._change(row, skipped=True)

    def is_skipped(self, row: int) -> bool:
        return row in self._results and self._results[row].skipped

    def open_rows(self, planned: Iterable[int]) -> list[int]:
        """List the planned rows that are neither done nor skipped."""
        return [
            row for row in planned if not (self._results[row].done or self._results[row].skipped)
        ]

    def _change(self, row: int, **changes: float | bool) -> None:
        self._results[row] = msgspec.structs.replace(self._results[row], **changes)
