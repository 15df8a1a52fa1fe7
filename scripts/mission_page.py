"""Print docs/mission.md: `python scripts/mission_page.py > docs/mission.md`."""

from __future__ import annotations

import math
import sys
from collections import defaultdict
from collections.abc import Mapping

from agribot.autonomy.control.stalled_turn import PIECE_RAD, STALLED_RATIO, STALLED_S
from agribot.autonomy.control.wheel_watch import HELD_LASTING_S
from agribot.autonomy.plan.mission.requests import TABLE, Column, Do, Ignore, Reaction, Refuse
from agribot.autonomy.plan.mission.row_recovery import LADDER
from agribot.autonomy.plan.ways.freeing import SAME_PLACE_M, TRIES

HEAD = """# The mission and what it is asked

Written by `make pages` from
[`requests.py`](../src/agribot/autonomy/plan/mission/requests.py).

A mission is in one of these states ([`states.py`](../src/agribot/autonomy/plan/mission/states.py)).
Status, page and recording show the word in the second column.

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
    ("paused", "`paused`", "stands", "a request"),
    ("ended", "`done`, `cancelled`, `failed`", "stands", "nothing"),
    ("open", "the same", "stays (`--stay`, `mission.waits_for_goals`)", "a request"),
)
RULES = """
A person, the [supervisor](safety.md#protective-stops) or a run that was cut off may **stop** the
robot. Until the stop is cleared the mission is paused or has ended, and "stopped", where it is
listed, counts before every state but "ended".

A request is done, *refused* (`refusal` of the status says why) or left alone (in brackets). What is
done may still be refused, for example where no way leads there.

| request | reaction |
|---|---|
"""
COLUMNS: dict[Column, str] = {
    "stopped": "stopped",
    "waiting": "waiting",
    "driving": "driving",
    "on_errand": "on an errand",
    "stopping": "stopping",
    "paused": "paused",
    "open": "open",
    "ended": "ended",
}

# Least number of states that a line does not name one by one.
MANY = 3

STUCK = f"""
## Where the robot is stuck

A turn that gets less than {100 * STALLED_RATIO:.0f} % of its command for {STALLED_S:g} s goes on
with {math.degrees(PIECE_RAD):.0f} degrees on the spot, which breaks the wheels loose; never where
crop stands beside them. Where the robot does not get on for {HELD_LASTING_S:g} s, it backs out over
its own track with the tool off and tries again with a run-up: {TRIES[0].back_m:g} m, then twice
{TRIES[1].back_m:g} m, then {TRIES[3].back_m:g} m, from the second try on
{100.0 * TRIES[1].left_m:g} cm to the left or right of its path. After `mission.free_tries` tries
within {SAME_PLACE_M:g} m, on an errand, backwards, or where it has only just set off, it
[stops](safety.md#protective-stops) until a person has looked.
[Measured](results/simulator.md#how-far-the-robot-gets-on-hard).
"""

LOST = """
## Where the row is lost

A robot that knows its place across the row worse than `mission.max_row_std_m`, or stands because it
may reach crop, takes these steps one after the other, with the tool off. It backs out straight
along its own way.

| step | what the robot does | when |
|---|---|---|
"""


def page() -> str:
    states = "".join(f"| {' | '.join(state)} |\n" for state in STATES)
    ladder = "".join(f"| {' | '.join(step)} |\n" for step in LADDER)
    return HEAD + states + RULES + _list_requests() + STUCK + LOST + ladder


def _list_requests() -> str:
    """Write a line for each reaction, with all requests that have it."""
    requests: defaultdict[str, list[str]] = defaultdict(list)
    for action, reactions in TABLE.items():
        requests[_describe(reactions)].append(f"`{action}`")
    return "".join(f"| {', '.join(names)} | {text} |\n" for text, names in requests.items())


def _describe(reactions: Mapping[Column, Reaction]) -> str:
    """Write each reaction behind its states; the one of most states comes last, without them."""
    states: defaultdict[str, list[str]] = defaultdict(list)
    for column, name in COLUMNS.items():
        if column in reactions:
            states[_cell(reactions[column])].append(name)
    last = max(states, key=lambda text: len(states[text]))
    if len(states) == 1:
        return last
    parts = [f"{', '.join(names)}: {text}" for text, names in states.items() if text != last]
    is_rest = len(states[last]) >= MANY and COLUMNS["stopped"] not in states[last]
    names = "otherwise" if is_rest else ", ".join(states[last])
    return "<br>".join([*parts, f"{names}: {last}"])


def _cell(reaction: Reaction) -> str:
    match reaction:
        case Do():
            return reaction.value
        case Refuse():
            return "*refused*"
        case Ignore():
            return f"({reaction.why})"


if __name__ == "__main__":
    sys.stdout.write(page())
