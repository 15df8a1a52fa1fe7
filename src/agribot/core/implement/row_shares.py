"""Weeds in the rows of the crop and between them, and how many of either were treated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import msgspec

from agribot.core.messages import Row
from agribot.core.row_shape import project_on_row, row_length_m

# Half width of the strip along a row that a camera-steered hoe leaves to the crop, m.
IN_ROW_M = 0.15


class TreatedShare(msgspec.Struct, frozen=True, kw_only=True):
    """Weeds of a part of the field, and those of them that were treated; no share without any."""

    of: int
    treated: int
    share: float | None


class RowPlace(NamedTuple):
    """A place by the row that is nearest to it: along its line, beside it, and off its ends."""

    row: Row
    along_m: float
    beside_m: float
    beyond_m: float

    @property
    def gap_m(self) -> float:
        return math.hypot(self.beside_m, self.beyond_m)


def find_nearest_row(x_map_m: float, y_map_m: float, rows: Sequence[Row]) -> RowPlace | None:
    """Find the row whose line, from its first plant to its last, is nearest; None without rows."""
    places = (_place_on(row, x_map_m, y_map_m) for row in rows)
    return min(places, key=lambda place: place.gap_m, default=None)


def share_by_rows(
    weeds: Iterable[tuple[float, float, bool]], rows: Sequence[Row]
) -> tuple[TreatedShare, TreatedShare]:
    """Count weeds (x_map_m, y_map_m, is_treated) nearer to a row than IN_ROW_M, and the others."""
    is_treated: dict[bool, list[bool]] = {True: [], False: []}
    for x_map_m, y_map_m, treated in weeds:
        place = find_nearest_row(x_map_m, y_map_m, rows)
        is_treated[place is not None and place.gap_m < IN_ROW_M].append(treated)
    return _count(is_treated[True]), _count(is_treated[False])


def _place_on(row: Row, x_map_m: float, y_map_m: float) -> RowPlace:
    along_m, left_m, _ = project_on_row(row, x_map_m, y_map_m)
    beyond_m = max(-along_m, along_m - row_length_m(row), 0.0)
    return RowPlace(row, float(along_m), abs(float(left_m)), float(beyond_m))


def _count(treated: list[bool]) -> TreatedShare:
    done = sum(treated)
    return TreatedShare(
        of=len(treated), treated=done, share=done / len(treated) if treated else None
    )
