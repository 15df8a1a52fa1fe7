"""Print docs/hazards.md: hazards, states of the gate and checks, from the tables in the code.

What was measured of each fault is read from docs/results/fault-campaign.csv. `make pages` writes
all such pages.
"""

from __future__ import annotations

import csv
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from agribot.autonomy.control.gate_machine import STATES
from agribot.autonomy.control.hazards import CHECKS, HAZARDS, ForHand, Hazard, Reaction
from agribot.core.config import EstimateConfig, SafetyConfig

CAMPAIGN = Path(__file__).parents[1] / "docs" / "results" / "fault-campaign.csv"
HEAD = """# Hazards

Written by `make pages` from
[`hazards.py`](../src/agribot/autonomy/control/hazards.py) and
[`gate_machine.py`](../src/agribot/autonomy/control/gate_machine.py).

The last gate before the motors works through this table in every tick, from top to bottom.
[Safety](safety.md) says what each reaction means for people, [faults](faults.md) how faults are
injected. The last column is read from [the measured campaign](results/fault-campaign.md): of each
fault the share of its runs in which it was noticed, by this row or by another, and the median time
until then. Small faults that change nothing are in it, such as a motor that is weak and need not be
strong; "-" where no fault proves the row.

| hazard | seen by | limit | reaction | holds a hand | proven by, and measured |
|---|---|---|---|---|---|
"""
REACTIONS: dict[Reaction, str] = {
    "latch": "**stops** until a person clears it",
    "wait": "stops until it is over",
    "slow": "slows down",
    "tool off": "tool off",
    "home": "turns home",
    "report": "is reported",
}
FOR_HAND: dict[ForHand, str] = {"yes": "yes", "until cleared": "until it is cleared", "no": "no"}
WHERE = """
The robot's own stop distance is that of its drive: at 0.4 m/s and 1.5 m/s^2 it rolls 5 cm after the
0.2 s that board and brakes take, 13 cm in all; `stop_distance_m_max` of
[`report.json`](recordings.md) is what it was in a run. A program that dies cannot stop anything:
then the motor board does, which must stop by itself when no command comes for its timeout.
Speed by surroundings is no row: turns and headlands have planned speeds, the edge of the field
counts with the way of braking, and no measurement shows a hazard that a lower speed there would
cure.

## States of the gate

The first of these that applies is the state. It stands, with the reason for which it was entered,
in `gate` of the status (`/agribot/mission/status`), in every tick of a recording, as lines of the
kind `gate` in `events.jsonl`, and as `safety.gate` in `report.json`.

| state | what passes | what ends it |
|---|---|---|
"""
CHECK_HEAD = """
## Before the start

Before the first motion of a mission, this list is gone through. Each item is the rows of the table
above that belong to it. One that is not good holds the start with its reason (state `checking`, or
`stopped` where the row stops); but for the camera, without which the tool is off and the robot
drives. A mission that has waited for more than 5 s, such as for a position near its map, has the
list published as well. What was found is reported by `agribot run`, by a line of the kind `check`
in `events.jsonl`, by `safety.checks` in `report.json`, and in the status.

| item | good unless |
|---|---|
"""
_SETTING = re.compile(r"`(safety|estimate)\.(\w+)`")
_DEFAULTS = {"safety": SafetyConfig(), "estimate": EstimateConfig()}


def page() -> str:
    with CAMPAIGN.open(encoding="utf-8", newline="") as lines:
        measured = read_campaign(csv.DictReader(lines))
    rows = "".join(_row(hazard, measured) for hazard in HAZARDS)
    states = "".join(f"| `{row.state}` | {row.passes} | {row.ends} |\n" for row in STATES)
    checks = "".join(f"| {name} | {_list_rows(name)} |\n" for name in CHECKS)
    return HEAD + rows + WHERE + states + CHECK_HEAD + checks


def read_campaign(table: Iterable[dict[str, str]]) -> dict[str, list[dict[str, str]]]:
    """Sort the measured rows by the name of their fault.

    What was measured twice counts by the more runs, or as it stands further down.
    """
    found: dict[str, dict[tuple[str, str], dict[str, str]]] = {}
    for row in table:
        if row["fault"] != "no fault":
            name = re.split("[=+]", row["fault"])[0]
            rows, place = found.setdefault(name, {}), (row["fault"], row["drive"])
            if place not in rows or int(row["runs"]) >= int(rows[place]["runs"]):
                rows[place] = row
    return {name: list(rows.values()) for name, rows in found.items()}


def _row(hazard: Hazard, measured: dict[str, list[dict[str, str]]]) -> str:
    cells = (
        hazard.name,
        hazard.seen_by,
        _SETTING.sub(_add_default, hazard.limit),
        REACTIONS[hazard.reaction],
        FOR_HAND[hazard.for_hand] + ("" if hazard.for_mission else ", a hand only"),
        "; ".join(_describe_fault(name, measured.get(name, [])) for name in hazard.faults) or "-",
    )
    return f"| {' | '.join(cells)} |\n"


def _describe_fault(name: str, rows: list[dict[str, str]]) -> str:
    noticed = _span([row["detected"] for row in rows], 0, " %")
    after = _span([row["after"] for row in rows], 1, " s")
    words = ", ".join(part for part in (noticed, after) if part) or "not measured"
    return f"`{name}` ({words})"


def _add_default(match: re.Match[str]) -> str:
    value = getattr(_DEFAULTS[match[1]], match[2])
    return f"{match[0]} ({value:g})" if isinstance(value, float) else f"{match[0]} ({value})"


def _span(cells: list[str], digits: int, unit: str) -> str:
    """Format the least and the largest of the numbers that were measured; empty without any."""
    values = [float(cell.split()[0]) for cell in cells if cell != "-"]
    if not values:
        return ""
    least, most = (f"{value:.{digits}f}" for value in (min(values), max(values)))
    return f"{least}{unit}" if least == most else f"{least} to {most}{unit}"


def _list_rows(check: str) -> str:
    return "; ".join(hazard.name for hazard in HAZARDS if hazard.check == check)


if __name__ == "__main__":
    sys.stdout.write(page())
