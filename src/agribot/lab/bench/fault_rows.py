"""What a campaign of faults found: one row for each scenario over its seeds, and the sum of all.

An undetected fault is harmless in a drive whose truth is what it is without a fault: no
farther off its row than twice what 95 % of the ticks without one are, or than the worst of them,
nothing crushed, and no farther outside. Ratios are over all faults, and without the harmless ones.
"""

from __future__ import annotations

import re
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

from agribot.core.facts import Said
from agribot.lab.bench.faults import ENDED, PRESET, FaultScenario, leave_out_fault
from agribot.lab.sweep.plan import SweepJob
from agribot.record.report import FaultReport, Report, SafetyEvent

HARMLESS_RATIO = 2.0
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")


class FaultRow(msgspec.Struct, frozen=True, kw_only=True):
    """One scenario over its seeds; what was never measured is None.

    `reaction` and `reason` are the most frequent ones; `ended_badly` counts the runs that a
    program error, an overturned robot or a diverging simulation ended. `crushed_after` counts all
    plants since the fault began, the others of them by when; `crushed_after_detectable` those
    since the robot noticed or could have, `crushed_by_fault` left out. `stop_allowed_m` is what
    the drive promises at the speed of the longest stop.
    """

    fault: str
    profile: str
    sensors: str
    has_camera: bool
    is_detectable: bool
    runs: int
    detected_ratio: float | None = None
    time_to_detect_s: float | None = None
    reaction: str = ""
    named_ratio: float | None = None
    crushed_after: int | None = None
    plants: int = 0
    outside_m_max: float | None = None
    stop_distance_m_max: float | None = None
    reason: str = ""
    ended_badly: int = 0
    why_ended: str = ""
    platform: str = "sim"
    injected: int = 0
    noticed: int = 0
    named: int = 0
    one_of_two: int = 0
    harmless: int = 0
    crushed_before_detection: int | None = None
    crushed_after_detection: int | None = None
    crushed_after_standstill: int | None = None
    crushed_by_fault: int | None = None
    crushed_after_detectable: int | None = None
    stop_allowed_m: float | None = None
    stops_too_long: int = 0
    distance_m: float = 0.0


class UsualDrive(NamedTuple):
    """What the same drives do without a fault: the most that is usual across a row, and outside."""

    across_m: float
    outside_m: float


def make_rows(
    scenarios: Sequence[FaultScenario], jobs: Sequence[SweepJob], reports: Mapping[str, Report]
) -> list[FaultRow]:
    """Make one row for each scenario that has a run, in their order.

    What the drive of the same seed also reports without a fault is no sign of one.
    """
    rows = []
    for scenario in scenarios:
        found = _find_reports(scenario, jobs, reports)
        usual = _find_reports(leave_out_fault(scenario), jobs, reports)
        if found:
            rows.append(_make_row(scenario, found, usual))
    return rows


def _find_reports(
    scenario: FaultScenario, jobs: Sequence[SweepJob], reports: Mapping[str, Report]
) -> dict[int, Report]:
    """Find the reports of a scenario by their seeds."""
    mine = (scenario.profile, scenario.list_settings())
    return {
        job.seed: reports[job.name]
        for job in jobs
        if job.name in reports and (job.profile, job.settings) == mine
    }


def _make_row(
    scenario: FaultScenario, found: Mapping[int, Report], usual: Mapping[int, Report]
) -> FaultRow:
    reports = tuple(found.values())
    ends = [r.reason.removeprefix(ENDED) for r in reports if r.reason.startswith(ENDED)]
    longest = max(reports, key=lambda report: report.safety.stop_distance_m_max or 0.0).safety
    row = FaultRow(
        fault=scenario.name,
        profile=scenario.profile,
        sensors=scenario.sensors,
        has_camera=scenario.has_camera,
        is_detectable=scenario.is_detectable,
        platform=scenario.platform,
        runs=len(reports),
        outside_m_max=max(r.safety.outside_m_max or 0.0 for r in reports),
        stop_distance_m_max=longest.stop_distance_m_max or 0.0,
        stop_allowed_m=longest.stop_allowed_m,
        stops_too_long=sum(r.safety.stops_too_long or 0 for r in reports),
        plants=sum(r.tracking.plants_total or 0 for r in reports),
        distance_m=sum(r.mission.distance_m or 0.0 for r in reports),
        ended_badly=len(ends),
        why_ended=_find_typical(ends),
    )
    if not scenario.fault:
        stops = [reason for report in reports for reason in list_false_stops(report)]
        return msgspec.structs.replace(
            row,
            reaction=f"{len(stops)} false stops",
            reason=_find_typical(stops),
            crushed_after=sum(r.tracking.plants_crushed or 0 for r in reports),
        )
    judged = {
        seed: tuple(_leave_out_usual(f, usual.get(seed)) for f in report.safety.faults)
        for seed, report in found.items()
    }
    if not any(judged.values()):
        return msgspec.structs.replace(row, reaction="never began")
    row = _add_verdicts(row, [fault for faults in judged.values() for fault in faults])
    spread = _measure_spread(tuple(usual.values()))
    harmless = sum(
        fault.detected_s is None and _is_usual(found[seed], spread)
        for seed, faults in judged.items()
        for fault in faults
    )
    return _add_crushes(msgspec.structs.replace(row, harmless=harmless), scenario, reports)


def _leave_out_usual(fault: FaultReport, usual: Report | None) -> FaultReport:
    """Return a fault as not noticed where every report also appears without it."""
    if usual is None:
        return fault
    usual_kinds = {_name_kind(event) for event in (*usual.safety.stops, *usual.safety.noticed)}
    if _name_kind(fault) not in usual_kinds:
        return fault
    return FaultReport(name=fault.name, t_s=fault.t_s, fault=fault.fault)


def _name_kind(event: SafetyEvent | FaultReport) -> tuple[object, ...]:
    """Return what stays the same while numbers change; words only where there is no code."""
    is_said = event.code in ("", Said.__struct_config__.tag)
    return event.code, event.parts, event.reason if is_said else ""


def _add_verdicts(row: FaultRow, faults: Sequence[FaultReport]) -> FaultRow:
    delays_s = [f.detected_s - f.t_s for f in faults if f.detected_s is not None]
    named = sum(f.is_named for f in faults)
    return msgspec.structs.replace(
        row,
        injected=len(faults),
        noticed=len(delays_s),
        named=named,
        one_of_two=sum(f.is_one_of_two for f in faults),
        detected_ratio=len(delays_s) / len(faults),
        time_to_detect_s=statistics.median(delays_s) if delays_s else None,
        reaction=_find_typical([f.reaction for f in faults]),
        named_ratio=named / len(faults),
        reason=_find_typical([f.reason for f in faults if f.reason]),
    )


def _measure_spread(usual: Sequence[Report]) -> UsualDrive | None:
    """Measure what drives without a fault do; None where none drove in a row."""
    p95_m = [r.tracking.xte_p95_m for r in usual if r.tracking.xte_p95_m is not None]
    most_m = [r.tracking.xte_max_m for r in usual if r.tracking.xte_max_m is not None]
    if not p95_m or not most_m:
        return None
    return UsualDrive(
        max(HARMLESS_RATIO * max(p95_m), *most_m),
        max(report.safety.outside_m_max or 0.0 for report in usual),
    )


def _is_usual(report: Report, spread: UsualDrive | None) -> bool:
    """Whether the truth of a drive is what it may be without a fault."""
    across_m, outside_m = report.tracking.xte_max_m, report.safety.outside_m_max
    if spread is None or across_m is None or outside_m is None:
        return False
    has_crushed = any(crush.when != "by_fault" for crush in report.safety.crushes)
    return across_m <= spread.across_m and outside_m <= spread.outside_m and not has_crushed


def _add_crushes(row: FaultRow, scenario: FaultScenario, reports: Sequence[Report]) -> FaultRow:
    when = Counter(crush.when for report in reports for crush in report.safety.crushes)
    return msgspec.structs.replace(
        row,
        crushed_after=sum(r.safety.crushed_after_fault or 0 for r in reports),
        crushed_before_detection=when["before_detection"],
        crushed_after_detection=when["after_detection"],
        crushed_after_standstill=when["after_standstill"],
        crushed_by_fault=when["by_fault"],
        crushed_after_detectable=sum(_count_avoidable(scenario, report) for report in reports),
    )


def _count_avoidable(scenario: FaultScenario, report: Report) -> int:
    """Count what was crushed after the robot had noticed, or could have."""
    faults = report.safety.faults
    known_s = [fault.detected_s for fault in faults if fault.detected_s is not None]
    if scenario.is_detectable:
        known_s += [fault.t_s + scenario.detectable_in_s for fault in faults]
    if not known_s:
        return 0
    return sum(c.t_s >= min(known_s) and c.when != "by_fault" for c in report.safety.crushes)


def list_false_stops(report: Report) -> list[str]:
    """List the stops of a run without a fault, and how it failed."""
    reasons = [stop.reason for stop in report.safety.stops]
    is_failed = report.reason.startswith(("mission failed", ENDED))
    return [*reasons, report.reason] if is_failed else reasons


def _find_typical(texts: Iterable[str]) -> str:
    """Return the first of those that differ in numbers only and are the most."""
    first: dict[str, str] = {}
    counts: Counter[str] = Counter()
    for text in texts:
        masked = _mask(text)
        first.setdefault(masked, text)
        counts[masked] += 1
    return first[counts.most_common(1)[0][0]] if counts else ""


def _mask(text: str) -> str:
    return _NUMBER.sub("#", text)


def summarise_rows(
    rows: Sequence[FaultRow], jobs: Sequence[SweepJob], reports: Mapping[str, Report]
) -> dict[str, Any]:
    """Sum up the campaign in the keys of `--json`.

    Ratios count every injected fault the same, the harmful ones leave out undetected faults
    without an effect. `crushed_ratio` is the share of all crop plants of the runs with a
    fault that were crushed after it.
    """
    bad = [row for row in rows if row.fault != "no fault"]
    good = [row for row in rows if row.fault == "no fault"]
    injected, harmless = sum(row.injected for row in bad), sum(row.harmless for row in bad)
    noticed, named = sum(row.noticed for row in bad), sum(row.named for row in bad)
    one_of_two = sum(row.one_of_two for row in bad)
    plants = sum(row.plants for row in bad)
    crushed = sum(row.crushed_after or 0 for row in bad)
    without = [job for job in jobs if "faults=[]" in job.settings and job.name in reports]
    return {
        "preset": PRESET,
        "faults": len(bad),
        "seeds": len({job.seed for job in jobs}),
        "detected_ratio": noticed / injected if injected else None,
        "named_ratio": named / injected if injected else None,
        "one_of_two_ratio": one_of_two / injected if injected else None,
        "harmless": harmless,
        "harmful_detected_ratio": noticed / (injected - harmless) if noticed else None,
        "harmful_named_ratio": named / (injected - harmless) if noticed else None,
        "harmful_one_of_two_ratio": one_of_two / (injected - harmless) if noticed else None,
        "crushed_after_detectable": sum(row.crushed_after_detectable or 0 for row in bad),
        "crushed_by_fault": sum(row.crushed_by_fault or 0 for row in bad),
        "crushed_ratio": crushed / plants if plants else None,
        "outside_m_max": max((row.outside_m_max or 0.0 for row in bad), default=None),
        "stops_too_long": sum(row.stops_too_long for row in rows),
        "false_stops": sum(len(list_false_stops(reports[job.name])) for job in without),
        "missions_without_fault": len(without),
        "km_without_fault": sum(row.distance_m for row in good) / 1000.0,
        "ended_badly": sum(row.ended_badly for row in rows),
        "rows": msgspec.to_builtins(rows),
    }
