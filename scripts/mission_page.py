"""Print docs/mission.md: `python scripts/mission_page.py > docs/mission.md`."""

from __future__ import annotations

import math
import sys

from agribot.autonomy.control.stalled_turn import PIECE_RAD, STALLED_RATIO, STALLED_S
from agribot.autonomy.control.wheel_watch import HELD_LASTING_S
from agribot.autonomy.plan.freeing import SAME_PLACE_M, TRIES
from agribot.autonomy.plan.requests import TABLE, Column, Do, Ignore, Reaction, Refuse
from agribot.autonomy.plan.row_recovery import LADDER
from agribot.core.fact_text import render
from agribot.core.messages import RequestWord

HEAD = """# The mission and what it is asked

Written by `make pages` from
[`requests.py`](../src/agribot/autonomy/plan/requests.py).

A mission is in one of these states ([`states.py`](../src/agribot/autonomy/plan/states.py)).
Status, page and recording know them by the word in the second column.

| state | word | what the robot does | what ends it |
|---|---|---|---|
"""
STATES = (
    ("waiting", "`waiting`", "stands until its position holds and its way is planned", "itself"),
    ("driving", "`running`", "drives its route and works", "the end of the route, or a fault"),
    (
        "on an errand",
        "`running`",
        "drives home, to a place, back to the work, or out of a row that it lost or a place where "
        "it is stuck, with the tool off",
        "the end of the way, or a fault",
    ),
    ("stopping", "`paused`", "comes to rest for an errand and plans its way there", "itself"),
    ("paused", "`paused`", "stands", "a person or a program that resumes it or sends it on"),
    (
        "ended",
        "`done`, `cancelled`, `failed`",
        "stands",
        "nothing; one that stays open (`--stay`, `mission.waits_for_goals`) can be sent on",
    ),
)
RULES = """
A **stop** is latched in one place, `core/latch.py`, for all that close it: a person, the
supervisor, or the run that was cut off before. While it holds, the mission is paused or has ended,
and the column *stopped* counts first; where that says "-", the state's own column counts. A mission
that has ended and does not stay open takes nothing, stopped or not.

Between the mission and the motors stands the gate, with [states](hazards.md#states-of-the-gate)
and a [list before the start](hazards.md#before-the-start) of its own.

A request is done, *refused* (`refusal` of the status says why), or left alone for the reason in
brackets. What is to be done is still refused where it cannot be: no way leads there, the plan is
not good, the robot was carried away.

"""
COLUMNS: dict[Column, str] = {
    "stopped": "stopped",
    "waiting": "waiting",
    "driving": "driving",
    "on_errand": "on an errand",
    "stopping": "stopping",
    "paused": "paused",
    "open": "ended, open",
    "ended": "ended",
}


STALLED = f"""
## Where a turn stalls

A skid-steer robot that turns in an arc lets its inner wheels nearly stand, and soft ground holds
them while the outer ones spin: the robot stands, however long they do. Where it turns by less than
{100 * STALLED_RATIO:.0f} % of what was asked for {STALLED_S:g} s, it takes the next
{math.degrees(PIECE_RAD):.0f} degrees on the spot, which turns all wheels against each other and
breaks them loose, and drives on along its turn
([`stalled_turn.py`](../src/agribot/autonomy/control/stalled_turn.py)). It does so between rows
only, never where crop stands beside its wheels, and not twice where it did not turn on the spot
either: then it is [stuck](#where-the-robot-is-stuck). In
`rows-10x12 --preset field` (RTK, seed 25) a robot that stood in its first turn until a person came
drives on after a second.
"""

STUCK = f"""
## Where the robot is stuck

Clods hold a wheel for a second or two, and the robot climbs over them. Where its wheels turn for
{HELD_LASTING_S:g} s and it does not get on, or not around, the gate holds it; after a second at
rest the mission backs out on the bend on which it came, tool off, by {TRIES[0].back_m:g} m, and
tries again with a run-up ([`freeing.py`](../src/agribot/autonomy/plan/freeing.py)); at the same
place, within {SAME_PLACE_M:g} m, it does so up to `mission.free_tries` times: twice from
{TRIES[1].back_m:g} m and then from {TRIES[3].back_m:g} m, driving {100.0 * TRIES[1].left_m:g} cm to
the left and to the right of its path by turns until it is {SAME_PLACE_M:g} m on, so that other
parts of its wheels meet the clods. In its rows it then counts on that much less room to the crop.
Held on its way back, it tries forwards. It backs out only over ground on which it has just come, so
that a robot that has only just set off does not try, nor one on an errand or backwards.
What is left the [gate](safety.md#protective-stops) stops, for a person to look. How far that leads
on the roughest ground is [measured](results/simulator.md#how-far-the-robot-gets-on-hard).
"""

LOST = """
## Where the row is lost

Known across its row worse than `mission.max_row_std_m`, or standing because it may reach crop, the
robot takes these steps, each where the one before has not helped
([`row_recovery.py`](../src/agribot/autonomy/plan/row_recovery.py)). Backing out it follows its own
way straight back, also where it is beside its row; the tool is off.

| step | what the robot does | when |
|---|---|---|
"""


def page() -> str:
    head = f"| request | {' | '.join(COLUMNS.values())} |\n|{'---|' * (len(COLUMNS) + 1)}\n"
    states = "".join(f"| {' | '.join(state)} |\n" for state in STATES)
    ladder = "".join(f"| {' | '.join(step)} |\n" for step in LADDER)
    return (
        HEAD + states + RULES + head + "".join(map(_row, TABLE)) + STALLED + STUCK + LOST + ladder
    )


def _row(action: RequestWord) -> str:
    cells = (_cell(TABLE[action].get(column)) for column in COLUMNS)
    return f"| `{action}` | {' | '.join(cells)} |\n"


def _cell(reaction: Reaction | None) -> str:
    match reaction:
        case Do():
            return reaction.value
        case Refuse():
            return f"*{render(reaction.why)}*"
        case Ignore():
            return f"({reaction.why})"
        case None:
            return "-"


if __name__ == "__main__":
    sys.stdout.write(page())
