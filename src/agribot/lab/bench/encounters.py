"""Encounters: people, animals and things step into the way of a robot that works, and are judged.

Each run is a drive along rows and turns of ROWS-10x12 with several of them (`sim.visitors`). An
encounter counts where the robot drove as it began.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

from agribot.core.encounter import Encounter
from agribot.lab.sweep.plan import SweepJob, read_seeds
from agribot.record.report import Report
from agribot.sim.visitors import EVERY_S, FIRST_S, MOVING_MPS, SPEEDS_MPS, STANDING_MPS

PROFILE, PRESET = "rows-10x12", "field"
DEFAULT_SEEDS = "1-4"
DEFAULT_SPEEDS = "0.4,0.6"
VISITORS = 6  # figures that step in, of each drive
IN_WAY = "obstacle_in_way"
AFTER_S = 1.5  # time after a visit in which the robot may still wait for it
# Bounds of the places ahead of the robot's front at which figures were aimed, m.
BOUNDS_M = (0.3, 0.6, 1.0, 2.0, 5.0)


def list_jobs(seeds: str, speeds_mps: Sequence[float], *, has_lidar: bool) -> tuple[SweepJob, ...]:
    """List all drives, each seed at each speed.

    Raises: ConfigError: a seed or a speed is not valid.
    """
    fixed = (
        f"sim.preset={PRESET}", "sim.sensors=rtk", "perception.enabled=false",
        "record.enabled=false", f"sim.lidar={str(has_lidar).lower()}", f"sim.visitors={VISITORS}",
        f"duration_s={FIRST_S + EVERY_S * VISITORS:g}",
    )  # fmt: skip
    jobs = tuple(
        SweepJob(
            name=f"{seed}-{speed_mps:g}", profile=PROFILE, seed=seed, fixed=fixed,
            settings=(f"mission.speed_mps={speed_mps:g}",),
        )
        for seed in read_seeds(seeds)
        for speed_mps in speeds_mps
    )  # fmt: skip
    for job in jobs:
        job.config()
    return jobs


def summarise(reports: Iterable[Report]) -> dict[str, Any]:
    """Sum up encounters, touches and waits for nothing."""
    reports = list(reports)
    met = [visit for report in reports for visit in list_met(report)]
    touched = [visit for visit in met if is_touched(visit)]
    stood_m = [visit.stood_m for visit in met if visit.stood_m is not None]
    km = sum(report.mission.distance_m or 0.0 for report in reports) / 1000.0
    waits = sum(count_false_waits(report) for report in reports)
    return {
        "drives": len(reports),
        "km": km,
        "encounters": len(met),
        "touched": len(touched),
        "touched_mps_max": max((v.touched_mps or 0.0 for v in touched), default=None),
        "ran_into_standing_robot": sum(visit.touched_mps is not None for visit in met)
        - len(touched),
        "stood": len(stood_m),
        "stood_m_min": min(stood_m, default=None),
        "stood_m_median": statistics.median(stood_m) if stood_m else None,
        "false_waits": waits,
        "false_waits_per_km": waits / km if km else None,
        "by_place": [_sum_up_place(met, low, high) for low, high in _list_places()],
        "by_figure": {kind: _count(v for v in met if v.figure == kind) for kind in SPEEDS_MPS},
        "touches": [_describe(visit) for visit in touched],
    }


def list_met(report: Report) -> list[Encounter]:
    """List the encounters that began while the robot drove."""
    return [visit for visit in report.safety.visits if visit.robot_mps > MOVING_MPS]


def is_touched(visit: Encounter) -> bool:
    """Whether the robot moved as it touched the figure."""
    return visit.touched_mps is not None and visit.touched_mps >= STANDING_MPS


def count_false_waits(report: Report) -> int:
    """Count how often the robot waited while no figure was there."""
    visits = report.safety.visits
    return sum(
        event.code == IN_WAY
        and not any(v.begin_s <= event.t_s <= v.end_s + AFTER_S for v in visits)
        for event in report.safety.gate
    )


def _list_places() -> list[tuple[float, float]]:
    return list(pairwise(BOUNDS_M))


def _sum_up_place(met: Sequence[Encounter], low_m: float, high_m: float) -> dict[str, Any]:
    here = [visit for visit in met if low_m <= visit.ahead_m < high_m]
    return {"from_m": low_m, "to_m": high_m, **_count(here)}


def _count(visits: Iterable[Encounter]) -> dict[str, int]:
    found = list(visits)
    return {"encounters": len(found), "touched": sum(map(is_touched, found))}


def _describe(visit: Encounter) -> dict[str, Any]:
    return {
        "figure": visit.figure, "aimed_m": visit.ahead_m, "figure_mps": visit.speed_mps,
        "touched_mps": visit.touched_mps, "touched_ahead_m": visit.touched_ahead_m,
    }  # fmt: skip


def format_table(result: dict[str, Any]) -> str:
    """Format where figures were aimed and which were touched, as a table of Markdown."""
    lines = ["| aimed at, ahead of the front | encounters | touched by the moving robot |",
             "|---|---|---|"]  # fmt: skip
    lines += [
        f"| {place['from_m']:g} to {place['to_m']:g} m | {place['encounters']} | "
        f"{place['touched']} |"
        for place in result["by_place"]
    ]
    return "\n".join(lines) + "\n"


def describe_result(result: dict[str, Any]) -> str:
    """Describe the result in one paragraph."""
    speed = result["touched_mps_max"]
    at_most = "" if speed is None else f" (at {speed:.2f} m/s at most)"
    stood = result["stood_m_median"]
    nearest = result["stood_m_min"]
    apart = "" if stood is None else f", at least {nearest:.2f} m and mostly {stood:.1f} m away"
    per_km = result["false_waits_per_km"]
    rate = "" if per_km is None or math.isnan(per_km) else f" ({per_km:.2g} a km)"
    return (
        f"{result['encounters']} encounters in {result['drives']} drives, {result['km']:.2f} km: "
        f"{result['touched']} touched by the moving robot{at_most}, "
        f"{result['ran_into_standing_robot']} ran into it while it stood; it stood for "
        f"{result['stood']}{apart}; {result['false_waits']} waits for nothing{rate}\n"
    )
