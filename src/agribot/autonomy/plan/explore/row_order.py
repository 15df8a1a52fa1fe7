"""Rows side by side in their order, and how a drifting pose shows in them.

A row is known by its place in the order: it is the one to the left of a driven row, at a known
distance, whatever the receiver's drift since. The distance of two rows was seen in the same
pictures, so that it contains no drift; where a row driven before now lies elsewhere beside the next
one, the pose has drifted meanwhile.
"""

from __future__ import annotations

from typing import Literal

from agribot.autonomy.plan.explore.beside import Neighbour
from agribot.autonomy.plan.explore.found_row import FoundRow

# Largest offset, as a share of the row distance, at which a row seen aside is a known one.
SAME_RATIO = 0.4
# Distance of two rows as pictures show it, 1 sigma, m.
APART_STD_M = 0.03

Side = Literal[1, -1]  # to the left of a row, and to its right, as its frame looks


class RowOrder:
    """Call `begin` with the first row, then `add_beside` with every one that was driven."""

    def __init__(self) -> None:
        self.rows: list[FoundRow] = []  # rows from the rightmost to the leftmost
        self._apart_m: list[float] = []  # distance of each row from the next one
        self._slid_m = 0.0  # shift of the pose to the left of the rows since the first was driven
        self._slid_at_m: dict[int, float] = {}  # the same when a row was driven, by its number

    def begin(self, row: FoundRow) -> None:
        self.rows, self._apart_m = [row], []

    def remove(self, row: FoundRow) -> None:
        """Take out what was no row."""
        at = self.rows.index(row)
        del self.rows[at]
        if 0 < at <= len(self.rows) - 1:
            self._apart_m[at - 1 : at + 1] = [sum(self._apart_m[at - 1 : at + 1])]
        elif self._apart_m:
            del self._apart_m[min(at, len(self._apart_m) - 1)]

    def add_beside(self, row: FoundRow, seen: dict[Side, Neighbour | None]) -> None:
        """Take in what was seen to both sides of a row that was driven now."""
        self._follow_drift(row, seen)
        self._slid_at_m[row.index] = self._slid_m
        for side, beside in seen.items():
            if beside is not None and self._find(row, side, abs(beside.left_m)) is None:
                self._insert(row, side, beside)

    def settle(self) -> None:
        """Put the rows where the pose had them while they were driven, weighed by its variance."""
        driven = [row for row in self.rows if row.index in self._slid_at_m and row.pos_std_m > 0.0]
        weights = [1.0 / row.pos_std_m**2 for row in driven]
        slid_m = [self._slid_m - self._slid_at_m[row.index] for row in driven]
        if driven:
            back_m = sum(w * m for w, m in zip(weights, slid_m, strict=True)) / sum(weights)
            self._move(-back_m, but=None)

    def _follow_drift(self, row: FoundRow, seen: dict[Side, Neighbour | None]) -> None:
        """Carry all other rows along with the pose as it has drifted since they were driven."""
        slid_m = []
        for side, beside in seen.items():
            other = None if beside is None else self._find(row, side, abs(beside.left_m))
            if beside is not None and other is not None and other.is_driven:
                middle_m = (row.first_m + row.last_m) / 2.0
                line = row.line_at(middle_m)
                _, was_m = line.locate(*other.line_at(middle_m).xy_m)
                slid_m.append(beside.left_m - was_m)
        if not slid_m:
            return
        weight = row.pos_std_m**2 / (row.pos_std_m**2 + APART_STD_M**2)
        by_m = weight * sum(slid_m) / len(slid_m)
        self._slid_m += by_m
        self._move(by_m, but=row)

    def _move(self, left_m: float, but: FoundRow | None) -> None:
        for each in self.rows:
            if each is not but:
                each.move(left_m)

    def _find(self, row: FoundRow, side: Side, apart_m: float) -> FoundRow | None:
        """Find the row that is known to stand at this distance to one side of another."""
        reach_m = 0.0
        for gap_m, other in self._list_beside(row, side):
            reach_m += gap_m
            if abs(reach_m - apart_m) < SAME_RATIO * apart_m:
                return other
        return None

    def _insert(self, row: FoundRow, side: Side, beside: Neighbour) -> None:
        """Put a new row into the order, between two that are known or behind the last one."""
        other = FoundRow(max(each.index for each in self.rows) + 1, row.frame)
        other.add_from_beside(beside.left_m, beside.pieces, row)
        before_m, at = 0.0, self.rows.index(row)
        apart_m, steps = abs(beside.left_m), 0
        for gap_m, _ in self._list_beside(row, side):
            if before_m + gap_m > apart_m:
                break
            before_m, steps = before_m + gap_m, steps + 1
        place, rest_m = at + side * steps, apart_m - before_m  # the row that it stands next to
        gap = place if side > 0 else place - 1
        if 0 <= gap < len(self._apart_m):
            gaps_m = [rest_m, self._apart_m[gap] - rest_m]
            self._apart_m[gap : gap + 1] = gaps_m if side > 0 else gaps_m[::-1]
        else:
            self._apart_m.insert(max(gap, 0), rest_m)
        self.rows.insert(place + 1 if side > 0 else place, other)

    def _list_beside(self, row: FoundRow, side: Side) -> list[tuple[float, FoundRow]]:
        """List rows to one side of a row, the nearest first, with the way from one to the next."""
        at = self.rows.index(row)
        if side > 0:
            return list(zip(self._apart_m[at:], self.rows[at + 1 :], strict=True))
        return list(zip(reversed(self._apart_m[:at]), reversed(self.rows[:at]), strict=True))
