"""Whole missions in the full simulator, with the rendered camera and the network, over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec

from agribot.lab.sweep.plan import SweepJob, plan
from agribot.lab.sweep.tables import pooled_rms_m

# Settings of every mission; without recordings: repeat a failed run with one.
FIXED = ("record.enabled=false",)
PRESET = "field"  # preset of the world, unless another one is asked for


class Weeding(NamedTuple):
    """Requirements of a series: shares of true crops mapped and of true weeds treated, at least.

    No crop may be hit, and the sprayed share of the rows' ground has an upper limit.
    """

    crop_recall: float
    treated_ratio: float
    area_ratio: float


class Case(NamedTuple):
    """A profile with receivers, the seeds it is driven on, and what it must hold, if anything."""

    profile: str
    sensors: tuple[str, ...]
    seeds: tuple[int, ...]
    max_rms_m: float | None = None
    weeding: Weeding | None = None


CASES = (
    Case("farm", ("rtk",), tuple(range(1, 21)), 0.025),
    Case("farm", ("legacy", "seed", "m8n"), tuple(range(1, 11))),
    Case("rows-10x12", ("m8n",), tuple(range(1, 21)), 0.025),
    Case("hills", ("m8n", "rtk"), tuple(range(1, 11)), 0.06),
    Case("beet", ("rtk",), tuple(range(1, 6))),
    Case("beet", ("m8n",), tuple(range(1, 11)), None, Weeding(0.75, 0.5, 0.10)),
)


def list_jobs(
    profiles: Sequence[str], seeds: Sequence[int] | None, preset: str = PRESET
) -> tuple[SweepJob, ...]:
    """List all runs, the first seed of everything before the second: what fails shows early."""
    fixed = (*FIXED, f"sim.preset={preset}")
    found = [
        msgspec.structs.replace(job, name=f"{case.profile}-{number}-{job.name}")
        for number, case in enumerate(CASES)
        if case.profile in profiles
        for job in plan(
            case.profile, seeds or case.seeds, fixed, [f"sim.sensors={','.join(case.sensors)}"]
        )
    ]
    return tuple(sorted(found, key=lambda job: job.seed))


def find_shortfalls(summary: Sequence[dict[str, Any]]) -> list[str]:
    """Describe where the cross-track error or the weeding is worse than the case allows."""
    cases = {(case.profile, sensors): case for case in CASES for sensors in case.sensors}
    short = []
    for entry in summary:
        case = cases.get((entry["profile"], entry["settings"].get("sim.sensors", "")))
        if case is None:
            continue
        found = [] if case.weeding is None else _judge_weeding(entry, case.weeding)
        rms_m, limit_m = pooled_rms_m(entry), case.max_rms_m
        if rms_m is not None and limit_m is not None and rms_m > limit_m:
            found.append(f"cross-track RMS {100.0 * rms_m:.1f} cm > {100.0 * limit_m:g} cm")
        settings = " ".join(f"{key}={value}" for key, value in entry["settings"].items())
        short += [f"{entry['profile']} {settings}: {what}" for what in found]
    return short


def _judge_weeding(entry: dict[str, Any], limits: Weeding) -> list[str]:
    """Describe where the mean of a series falls short; crops hit are those of its worst mission."""
    mean, worst = entry["mean"], entry["max"]
    found = []
    recall = mean.get("weeds.crop_recall")
    if recall is not None and recall < limits.crop_recall:
        found.append(f"{recall:.2f} of the crops mapped < {limits.crop_recall:g}")
    truth, treated = mean.get("weeds.truth"), mean.get("weeds.treated_true")
    if truth and treated is not None and treated / truth < limits.treated_ratio:
        found.append(f"{treated / truth:.2f} of the weeds treated < {limits.treated_ratio:g}")
    hit = worst.get("weeds.crops_hit")
    if hit:
        found.append(f"{hit:g} crops hit in one mission > 0")
    area = mean.get("weeds.spray_area_ratio")
    if area is not None and area > limits.area_ratio:
        found.append(f"{area:.2f} of the ground sprayed > {limits.area_ratio:g}")
    return found
