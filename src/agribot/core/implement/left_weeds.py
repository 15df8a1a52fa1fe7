"""Why weeds were left that no implement says a reason of: where its tool passed and where not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, Protocol

from agribot.core.implement.row_shares import find_nearest_row
from agribot.core.messages import Row

ROW_NOT_DRIVEN = "row not driven"
RUN_ENDED = "run ended early"
ENDED_BY_OPERATOR = "run ended by the operator"
NO_TOOL = "no tool on the robot"
OUTSIDE_ROWS = "outside the rows"
OUTSIDE_TOOL = "outside the tool"
# Untreated before it was on the map, or by a tool that names no reasons.
PASSED = "passed by the tool"


class Left(Protocol):
    """A weed of the map at the end: where it stands, when it was treated, or why not."""

    @property
    def x_map_m(self) -> float: ...
    @property
    def y_map_m(self) -> float: ...
    @property
    def treated_s(self) -> float | None: ...
    @property
    def left(self) -> str: ...


class Passage(NamedTuple):
    """Passage of a tool of `width_m` along rows; None: the robot has no tool.

    `is_passed` gets a row and how far along it; `not_passed` is why the rest was not.
    """

    rows: Sequence[Row]
    is_passed: Callable[[Row, float], bool]
    width_m: float | None
    not_passed: str

    def explain(self, x_map_m: float, y_map_m: float) -> str:
        """Say what happened at a place for which the implement states no reason."""
        place = find_nearest_row(x_map_m, y_map_m, self.rows)
        if self.width_m is None:
            return NO_TOOL
        if place is None or place.beyond_m > 0.0:
            return OUTSIDE_ROWS
        if not self.is_passed(place.row, place.along_m):
            return self.not_passed
        return OUTSIDE_TOOL if place.beside_m > self.width_m / 2.0 else PASSED


def count_left(weeds: Iterable[Left], passage: Passage) -> dict[str, int]:
    """Count the weeds that were not treated, by the reason why, the most frequent first."""
    return count_reasons(
        weed.left or passage.explain(weed.x_map_m, weed.y_map_m)
        for weed in weeds
        if weed.treated_s is None
    )


def count_reasons(reasons: Iterable[str]) -> dict[str, int]:
    """Count reasons, the most frequent first."""
    return dict(sorted(Counter(reasons).items(), key=lambda item: (-item[1], item[0])))
