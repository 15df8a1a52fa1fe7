"""Whole missions in the full simulator, with the rendered camera and the network, over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec

from agribot.lab.sweep.plan import SweepJob, plan
from agribot.lab.sweep.tables import pooled_rms_m

# Nobody reads hundreds of recordings; a run that failed is repeated with its own.
FIXED = ("record.enabled=false",)
PRESET = "field"  # of the world, unless another one is asked for


class Case(NamedTuple):
    """A profile with receivers, the seeds it is driven on, and the error it must hold, if any."""

    profile: str
    sensors: tuple[str, ...]
    seeds: tuple[int, ...]
    max_rms_m: float | None = None


CASES = (
    Case("farm", ("rtk",), tuple(range(1, 21)), 0.025),
    Case("farm", ("legacy", "seed", "m8n"), tuple(range(1, 11))),
    Case("rows-10x12", ("m8n",), tuple(range(1, 21)), 0.025),
    Case("hills", ("m8n", "rtk"), tuple(range(1, 11)), 0.06),
    Case("beet", ("rtk",), tuple(range(1, 6))),
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
    """Tell in words where the cross-track error is larger than the case allows."""
    limits = {(case.profile, sensors): case.max_rms_m for case in CASES for sensors in case.sensors}
    short = []
    for entry in summary:
        limit_m = limits.get((entry["profile"], entry["settings"].get("sim.sensors", "")))
        rms_m = pooled_rms_m(entry)
        if rms_m is not None and limit_m is not None and rms_m > limit_m:
            settings = " ".join(f"{key}={value}" for key, value in entry["settings"].items())
            short.append(
                f"{entry['profile']} {settings}: cross-track RMS {100.0 * rms_m:.1f} cm > "
                f"{100.0 * limit_m:g} cm"
            )
    return short
