"""The matrix as text: faults by states, pairs, its red cells, its sum, and a CSV file of all."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from agribot.lab.bench.fault_matrix.cells import BURST_S, BURSTS, EVERY_S, ONCE_S, RISE_S
from agribot.lab.bench.fault_matrix.states import STATES
from agribot.lab.bench.fault_matrix.verdict import CellVerdict

HEADS = ("fault", "also", "state", "course", "seed", "noticed after s", "named", "reaction", "code",
         "way after noticeable m", "crushed", "crushed after noticeable", "outside m", "rolled m",
         "over level ratio", "accused first", "blamed", "harmless", "red")  # fmt: skip
COURSE_MARKS = {"once": "o", "for good": "g", "comes and goes": "c", "grows": "r"}
RED, HARMLESS, UNSEEN, NEVER = "**R**", "·", "-", "n"
LEGEND = (
    "Each cell has the seconds until the robot noticed the fault, and the fault's course: "
    f"`o` once for {ONCE_S:g} s, `g` for good, `c` {BURSTS} times {BURST_S:g} s, every "
    f"{EVERY_S:g} s, `r` rising for {RISE_S:g} s. `{HARMLESS}`: not noticed and without effect. "
    f"{RED}: red, see below. `{NEVER}`: the state was never reached.\n"
)


def format_matrix(verdicts: Sequence[CellVerdict]) -> str:
    """Format the single faults: a line for each, a column for each state."""
    single = [verdict for verdict in verdicts if not verdict.also]
    return _format_grid("fault", single, lambda v: v.fault, lambda v: v.state, _list_states(single))


def format_pairs(verdicts: Sequence[CellVerdict]) -> str:
    """Format the pairs: a line for the fault that was there, a column for the one that came."""
    pairs = [verdict for verdict in verdicts if verdict.also]
    seconds = tuple(dict.fromkeys(verdict.also for verdict in pairs))
    return _format_grid("first, then", pairs, lambda v: v.fault, lambda v: v.also, seconds)


def _list_states(verdicts: Sequence[CellVerdict]) -> tuple[str, ...]:
    known = {verdict.state for verdict in verdicts}
    return tuple(state.name for state in STATES if state.name in known)


def _format_grid(
    corner: str,
    verdicts: Sequence[CellVerdict],
    line_of: Callable[[CellVerdict], str],
    column_of: Callable[[CellVerdict], str],
    columns: Sequence[str],
) -> str:
    lines = [f"|{corner}|{'|'.join(columns)}|", "|---" * (len(columns) + 1) + "|"]
    for line in dict.fromkeys(map(line_of, verdicts)):
        mine = [verdict for verdict in verdicts if line_of(verdict) == line]
        cells = (
            ",".join(_format_cell(v) for v in mine if column_of(v) == column) for column in columns
        )
        lines.append(f"|`{line}`|{'|'.join(cells)}|")
    return "\n".join(lines) + "\n"


def _format_cell(verdict: CellVerdict) -> str:
    if not verdict.began:
        return NEVER
    mark = COURSE_MARKS[verdict.course]
    if verdict.noticed_s is not None:
        seen = f"{verdict.noticed_s:.1f}{mark}"
    else:
        seen = f"{HARMLESS if verdict.is_harmless else UNSEEN}{mark}"
    return f"{RED}{seen}" if verdict.red else seen


def format_red(verdicts: Sequence[CellVerdict]) -> str:
    """Format the red cells, one line each."""
    red = [verdict for verdict in verdicts if verdict.red]
    if not red:
        return "No cell is red.\n"
    lines = ["|fault|state|course|seed|noticed|red|", "|---" * 6 + "|"]
    for verdict in red:
        faults = f"`{verdict.fault}`" + (f", `{verdict.also}`" if verdict.also else "")
        after = "-" if verdict.noticed_s is None else f"{verdict.noticed_s:.1f}"
        lines.append(
            f"|{faults}|{verdict.state}|{verdict.course}|{verdict.seed}|{after}|"
            f"{'; '.join(verdict.red)}|"
        )
    return "\n".join(lines) + "\n"


def describe(result: Mapping[str, Any]) -> str:
    """Summarize the matrix in two paragraphs."""
    cpu_min = result["cpu_s"] / 60.0
    return (
        f"{result['cells']} cells, {result['pairs']} of them of two faults: {result['faults']} "
        f"faults in {result['states']} states on {result['seeds']} seeds, {cpu_min:.0f} minutes of "
        f"a CPU. The robot noticed {_percent(result['detected_ratio'])} and named the part of "
        f"{_percent(result['named_ratio'])}, as one of two of "
        f"{_percent(result['one_of_two_ratio'])}. {result['harmless']} times the fault stayed "
        "unnoticed and without effect; of the others it noticed "
        f"{_percent(result['harmful_detected_ratio'])} and named "
        f"{_percent(result['harmful_named_ratio'])}. In {result['accused_first']} cells a part "
        f"that is well was named first. {result['red']} cells are red.\n\n"
        f"Crushed: {result['crushed']} plants ({_percent(result['crushed_ratio'], 3)}), "
        f"{result['crushed_after_detectable']} of them after the fault was noticed or noticeable. "
        f"Outside the field at most {_metres(result['outside_m_max'])}; a robot that had to stand "
        f"rolled at most {_metres(result['rolled_m_max'])}; {result['stops_too_long']} stops took "
        "more than the drive promises. The true error was above the protection level for "
        f"{_percent(result['over_level_ratio'], 2)} of the time, in {result['cells_over_level']} "
        f"cells, for {_percent(result['over_level_ratio_max'], 0)} of the time in the worst. "
        f"{result['missions_without_fault']} drives without a fault, "
        f"{result['km_without_fault']:.2f} km, saw {result['false_stops']} false stops.\n"
    )


def _percent(ratio: float | None, digits: int = 0) -> str:
    return "-" if ratio is None else f"{100.0 * ratio:.{digits}f} %"


def _metres(way_m: float | None) -> str:
    return "-" if way_m is None else f"{way_m:.2f} m"


def format_page(result: Mapping[str, Any], verdicts: Sequence[CellVerdict]) -> str:
    """Format all that a page shows."""
    return "\n".join(
        (
            describe(result), LEGEND, format_matrix(verdicts),
            "Pairs: the first fault lasts, and the second comes after 4 s, for good.\n",
            format_pairs(verdicts), format_red(verdicts),
        )
    )  # fmt: skip


def format_csv(verdicts: Sequence[CellVerdict]) -> str:
    """Format one line for each cell."""
    target = io.StringIO()
    writer = csv.writer(target, lineterminator="\n")
    writer.writerow(HEADS)
    writer.writerows(map(_list_cells, verdicts))
    return target.getvalue()


def _list_cells(verdict: CellVerdict) -> tuple[object, ...]:
    named = "yes" if verdict.is_named else "one of two" if verdict.is_one_of_two else "no"
    return (
        verdict.fault, verdict.also, verdict.state, verdict.course, verdict.seed,
        "" if verdict.noticed_s is None else f"{verdict.noticed_s:.2f}", named, verdict.reaction,
        verdict.code, f"{verdict.way_m:.2f}", verdict.crushed, verdict.crushed_noticeable,
        f"{verdict.outside_m:.2f}", f"{verdict.rolled_m:.2f}", f"{verdict.over_level_ratio:.4f}",
        " ".join(verdict.accused),
        " ".join(verdict.blamed), "yes" if verdict.is_harmless else "no", "; ".join(verdict.red),
    )  # fmt: skip
