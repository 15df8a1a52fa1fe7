"""The verdict on each cell: noticed, part named, reaction, metres, plants; and what is red in it.

An event counts as a sign of a fault only where the same drive without a fault has none of its kind.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec

from agribot.app.fault_verdict import SETTLE_S, judge_faults, name_kind
from agribot.lab.bench.fault_matrix.cells import Cell
from agribot.lab.bench.fault_matrix.driving import CellResult
from agribot.record.events import Event
from agribot.record.report import FaultReport, Reaction
from agribot.sim.faults.schedule import Fault, parse_fault

# Longest way outside, and of a robot that must stand, m: its contactors open within this.
OUTSIDE_M, ROLLED_M = 0.05, 0.7
HARMLESS_RATIO = 2.0
_REACTIONS: tuple[Reaction, ...] = ("stopped", "held", "slowed", "named", "none")


class CellVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """One cell: times count from the begin of its fault, ways and plants from what is said.

    `noticeable` is when the robot noticed it, or could have. `accused` are the parts of the first
    event that names any, where all of them are well; `blamed` are all parts that are well and were
    named by themselves. `red` lists what must not be.
    """

    fault: str
    also: str
    state: str
    course: str
    seed: int
    began: bool
    noticed_s: float | None
    is_named: bool
    is_one_of_two: bool
    reaction: Reaction
    code: str
    reason: str
    way_m: float  # driven after noticeable
    crushed: int
    crushed_noticeable: int
    crushed_noticed: int
    outside_m: float
    rolled_m: float
    stop_m: float
    stops_too_long: int
    over_level_ratio: float
    is_harmless: bool
    accused: tuple[str, ...]
    blamed: tuple[str, ...]
    plants: int
    error: str
    red: tuple[str, ...] = ()


def judge(result: CellResult, usual: CellResult, across_m: float) -> CellVerdict:
    """Judge a cell beside the same drive without a fault.

    `across_m` is how far off the row a drive may be without one.
    """
    cell = result.cell
    texts = cell.list_faults(result.onset_s)
    signs = _leave_out_usual(result.events, usual.events)
    found = judge_faults(texts, signs)
    faults = [parse_fault(text) for text in texts]
    noticed_s = min((f.detected_s for f in found if f.detected_s is not None), default=None)
    strongest = _find_strongest(found)
    noticeable_s = min(
        result.onset_s + cell.detectable_in_s, math.inf if noticed_s is None else noticed_s
    )
    crushes_s = [crush.t_s for crush in result.crushes if not _is_handled(crush.t_s, faults)]
    verdict = CellVerdict(
        fault=cell.fault,
        also=cell.also,
        state=cell.state,
        course=cell.course,
        seed=cell.seed,
        began=bool(found),
        noticed_s=None if noticed_s is None else noticed_s - result.onset_s,
        is_named=any(one.is_named for one in found),
        is_one_of_two=any(one.is_one_of_two for one in found),
        reaction=strongest.reaction if strongest else "none",
        code=strongest.code if strongest else "",
        reason=strongest.reason if strongest else "",
        way_m=_measure_way_m(result.way, noticeable_s),
        crushed=len(crushes_s),
        crushed_noticeable=sum(t_s >= noticeable_s for t_s in crushes_s),
        crushed_noticed=sum(noticed_s is not None and t_s >= noticed_s for t_s in crushes_s),
        outside_m=max(result.outside_m - usual.outside_m, 0.0),
        rolled_m=result.rolled_m,
        stop_m=result.stop_m,
        stops_too_long=result.stops_too_long,
        over_level_ratio=result.over_level_ratio or 0.0,
        is_harmless=noticed_s is None and _is_usual(result, usual, across_m),
        accused=_find_accused(signs, faults),
        blamed=tuple(dict.fromkeys(_list_blamed(signs, faults))),
        plants=result.plants,
        error=result.error,
    )
    return msgspec.structs.replace(verdict, red=tuple(_list_red(verdict)))


def _leave_out_usual(events: Sequence[Event], usual: Sequence[Event]) -> list[Event]:
    """Leave out what is reported after the first fault as it is without one."""
    known = {name_kind(event) for event in usual}
    first = next((k for k, event in enumerate(events) if event.kind == "injected"), len(events))
    later = (e for e in events[first:] if e.kind == "injected" or name_kind(e) not in known)
    return [*events[:first], *later]


def _find_strongest(found: Sequence[FaultReport]) -> FaultReport | None:
    """Find the report with the strongest reaction, of those that name the part if any does."""
    seen = [report for report in found if report.detected_s is not None]
    named = [report for report in seen if report.is_named] or seen
    return min(named, key=lambda report: _REACTIONS.index(report.reaction), default=None)


def _is_handled(t_s: float, faults: Sequence[Fault]) -> bool:
    """Whether hands held the robot then."""
    return any(
        fault.handled_until_s is not None
        and fault.begin_s <= t_s <= fault.handled_until_s + SETTLE_S
        for fault in faults
    )


def _measure_way_m(way: Sequence[tuple[float, float]], from_s: float) -> float:
    later = [way_m for t_s, way_m in way if t_s >= from_s]
    return later[-1] - later[0] if later else 0.0


def find_usual_across_m(references: Iterable[CellResult]) -> float:
    """Find how far off its row a drive without a fault may be: twice the 95 %, or the worst."""
    return max(
        (max(HARMLESS_RATIO * (r.across_p95_m or 0.0), r.across_max_m or 0.0) for r in references),
        default=0.0,
    )


def _is_usual(result: CellResult, usual: CellResult, across_m: float) -> bool:
    """Whether the truth of a drive is what it may be without a fault."""
    is_near = (result.across_max_m or 0.0) <= across_m
    is_inside = result.outside_m <= usual.outside_m + OUTSIDE_M
    return is_near and is_inside and not result.crushes and result.rolled_m <= ROLLED_M


def _list_accusing(signs: Sequence[Event]) -> Iterator[Event]:
    """List the events since the first fault that name parts."""
    has_begun = False
    for event in signs:
        has_begun = has_begun or event.kind == "injected"
        if (
            has_begun
            and event.parts
            and event.kind in ("fault", "stop", "hold", "limit", "mission")
        ):
            yield event


def _find_accused(signs: Sequence[Event], faults: Sequence[Fault]) -> tuple[str, ...]:
    first = next(_list_accusing(signs), None)
    faulty = {part for fault in faults for part in fault.kind.accepted}
    return first.parts if first is not None and faulty.isdisjoint(first.parts) else ()


def _list_blamed(signs: Sequence[Event], faults: Sequence[Fault]) -> Iterator[str]:
    faulty = {part for fault in faults for part in fault.kind.accepted}
    for event in _list_accusing(signs):
        if faulty.isdisjoint(event.parts):
            yield from event.parts


def _list_red(verdict: CellVerdict) -> Iterator[str]:
    if verdict.error:
        yield f"ended by {verdict.error}"
    if verdict.crushed_noticeable:
        yield f"{verdict.crushed_noticeable} plants crushed after it was noticed or noticeable"
    if verdict.outside_m > OUTSIDE_M:
        yield f"{verdict.outside_m:.2f} m outside"
    if verdict.rolled_m > ROLLED_M:
        yield f"{verdict.rolled_m:.1f} m rolled while it had to stand"
    if verdict.stops_too_long:
        yield f"{verdict.stop_m:.2f} m to a standstill, more than promised"
    if verdict.began and verdict.noticed_s is None and not verdict.is_harmless:
        yield "not noticed, and not harmless"
    if verdict.accused:
        yield f"{', '.join(verdict.accused)} accused first"


def judge_all(results: Mapping[Cell, CellResult]) -> tuple[CellVerdict, ...]:
    """Judge all cells whose reference was driven."""
    across_m = find_usual_across_m(r for cell, r in results.items() if not cell.fault)
    return tuple(
        judge(result, results[cell.reference], across_m)
        for cell, result in results.items()
        if cell.fault and cell.reference in results
    )
