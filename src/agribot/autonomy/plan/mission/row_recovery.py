"""What a robot does that has lost its row: one table of steps, the mildest first.

It backs out along the way it came, which wheels and gyro know to centimetres, and enters anew:
a camera finds a row from before it, where nothing is crushed by a robot that is aside.
"""

from __future__ import annotations

from collections import Counter
from typing import Literal, NamedTuple

from agribot.autonomy.plan.mission.errand_kind import ErrandKind
from agribot.autonomy.plan.mission.route import Route
from agribot.core.messages import Estimate, GnssQuality

# Time of standing and looking, s; enough where GNSS or light comes back.
LOOK_S = 10.0
# Way of backing out past the last place where it was sure of its row, to see it again, and the
# longest way of backing out, m.
SURE_M, MAX_BACK_M = 1.5, 20.0
# Found again this far aside of its row, m, it would steer through plants to get back astride it.
ASIDE_M = 0.15
# Most successive rows left out; after them, the fault is not one of a row.
MOST_LEFT_OUT = 2

Way = Literal[ErrandKind.BACK, ErrandKind.OUT]


class Rung(NamedTuple):
    """A rung of the ladder, for people: `docs/mission.md` shows the table."""

    name: str
    what: str
    when: str


LADDER = (
    Rung("creep", "drives on at a quarter of its speed", "first, for 10 s"),
    Rung("look", f"stands for {LOOK_S:g} s", "the row is still lost"),
    Rung("back", f"backs out to {SURE_M:g} m before the last place where it was sure of its row, "
         "or before the row, and drives on from there",
         "the row is still lost, a camera looks and no sensor is known to fail; or the row was "
         f"found again, more than {ASIDE_M:g} m aside"),
    Rung("leave out", "backs out before the row, skips it and goes on with the next",
         "the same row is lost again, and its crop was seen before or RTK shows which row it is; "
         f"at most {MOST_LEFT_OUT} rows one after the other"),
    Rung("ask", "stands; after `mission.stall_timeout_s` the mission is paused where the robot may "
         "reach crop, and fails elsewhere",
         "in all other cases, and always without a camera"),
)  # fmt: skip


class RowRecovery:
    """Call `judge` with every tick of a drive along the rows."""

    def __init__(self) -> None:
        self._held_since_s: float | None = None
        self._was_lost = False
        self._sure_s_m = 0.0
        self._tries: Counter[int] = Counter()
        self._seen: set[int] = set()  # rows in which crop was seen
        self._left_out: list[int] = []

    def restart(self) -> None:
        """Begin the ladder anew: a person bids the robot go on."""
        self._held_since_s, self._was_lost = None, False
        self._tries.clear()
        self._left_out.clear()

    def judge(
        self, route: Route, estimate: Estimate, *, is_held: bool, is_lost: bool
    ) -> tuple[Way, float] | None:
        """Give the next step, and how far along the route it leads back; None to go on as it is.

        `is_held`: the robot must stand; `is_lost`: it does not know where its row is.
        """
        found_aside = self._was_lost and not is_lost and _is_aside(route)
        self._was_lost = is_lost
        if not is_held:
            self._held_since_s = None
            if estimate.row_seen and not is_lost:
                self._sure_s_m = route.progress.s_m
                self._seen.add(route.row_here)
        elif self._held_since_s is None:
            self._held_since_s = estimate.t_s
        has_looked = self._held_since_s is not None
        has_looked = has_looked and estimate.t_s - (self._held_since_s or 0.0) >= LOOK_S
        may_try = estimate.row_seen is not None and estimate.fact is None
        if not may_try or not (has_looked or found_aside):
            return None
        is_row_known = estimate.quality is GnssQuality.RTK_FIXED or route.row_here in self._seen
        return self._choose(route, is_aside=found_aside, is_row_known=is_row_known)

    def _choose(
        self, route: Route, *, is_aside: bool, is_row_known: bool
    ) -> tuple[Way, float] | None:
        row, here_m = route.row_here, route.progress.s_m
        if row < 0:
            return None
        self._held_since_s = None
        self._tries[row] += 1
        before_m = float(route.path.s_m[route.before_row])
        if self._tries[row] == 1:
            to_m = before_m if is_aside else max(before_m, min(self._sure_s_m, here_m) - SURE_M)
            return (ErrandKind.BACK, to_m) if here_m - to_m <= MAX_BACK_M else None
        # Bare ground from the first metre on may be no row at all: then the count of rows is off.
        may_leave_out = is_row_known and self._may_leave_out(row)
        if self._tries[row] > 2 or here_m - before_m > MAX_BACK_M or not may_leave_out:
            return None
        self._left_out.append(row)
        return ErrandKind.OUT, before_m

    def _may_leave_out(self, row: int) -> bool:
        """Return whether a row may be left out: not as the last of too many one after the other."""
        last = self._left_out[-MOST_LEFT_OUT:]
        return len(last) < MOST_LEFT_OUT or abs(row - last[-1]) > 1


def _is_aside(route: Route) -> bool:
    return route.row_here >= 0 and abs(route.progress.cross_track_m) > ASIDE_M
