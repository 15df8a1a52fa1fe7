"""Print docs/hazards.md: hazards, states of the gate and checks, from the tables in the code.

`make pages` writes all such pages.
"""

from __future__ import annotations

import re
import sys

from agribot.autonomy.control.gate_machine import STATES
from agribot.autonomy.control.hazards import CHECKS, HAZARDS, Hazard
from agribot.core.config import EstimateConfig, SafetyConfig

HEAD = """# Hazards

Written by `make pages` from
[`hazards.py`](../src/agribot/autonomy/control/hazards.py) and
[`gate_machine.py`](../src/agribot/autonomy/control/gate_machine.py).

The last gate before the motors works through this table in every tick, from top to bottom.
[Safety](safety.md) says what it means for people.

- **Reaction.** *latch*: the robot stops until a person clears the stop. *wait*: it stops until the
  hazard is over. *slow*: it slows down. *tool off*: the tool stops. *home*: the mission turns home.
  *report*: a message.
- **By hand.** Whether it also holds a person who drives; *until cleared*: once.
- **Proven by.** The [faults](faults.md) of the simulator that prove the row; how often and how soon
  each is noticed stands in [the campaign](results/fault-campaign.md).

| hazard | seen by | limit | reaction | by hand | proven by |
|---|---|---|---|---|---|
"""
WHERE = """
At 0.4 m/s and 1.5 m/s^2 the robot rolls 5 cm after the 0.2 s that board and brakes take, 13 cm in
all; `stop_distance_m_max` of [`report.json`](recordings.md) is what it was in a run.

## States of the gate

The first of these that applies is the state. It stands with its reason in `gate` of the status
(`/agribot/mission/status`), in `events.jsonl`, and as `safety.gate` in `report.json`.

| state | what passes | what ends it |
|---|---|---|
"""
CHECK_HEAD = """
## Before the start

Before the first motion of a mission, the gate checks:
{items}.
An item that is not good holds the start with its reason (state `checking`, or `stopped` where the
row stops); without a camera the robot drives with the tool off. The result is reported by `agribot
run`, in the status, in `events.jsonl` (kind `check`) and as `safety.checks` in `report.json`.
"""
_SETTING = re.compile(r"`(safety|estimate)\.(\w+)`")
_DEFAULTS = {"safety": SafetyConfig(), "estimate": EstimateConfig()}


def page() -> str:
    rows = "".join(map(_row, HAZARDS))
    states = "".join(f"| `{row.state}` | {row.passes} | {row.ends} |\n" for row in STATES)
    items = ", ".join(CHECKS[:-1]) + f" and {CHECKS[-1]}"
    return HEAD + rows + WHERE + states + CHECK_HEAD.format(items=items)


def _row(hazard: Hazard) -> str:
    cells = (
        hazard.name,
        hazard.seen_by,
        _SETTING.sub(_add_default, hazard.limit),
        hazard.reaction,
        hazard.for_hand + ("" if hazard.for_mission else ", a hand only"),
        ", ".join(f"`{name}`" for name in hazard.faults) or "-",
    )
    return f"| {' | '.join(cells)} |\n"


def _add_default(match: re.Match[str]) -> str:
    value = getattr(_DEFAULTS[match[1]], match[2])
    return f"{match[0]} ({value:g})" if isinstance(value, float) else match[0]


if __name__ == "__main__":
    sys.stdout.write(page())
