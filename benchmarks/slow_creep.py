"""How soon a slow creep of fixes is doubted, and how often fixes without one are.

`python benchmarks/slow_creep.py [DRAWS]` draws drives of 300 s with the receiver of the preset
`rtk` and prints the table of docs/results/localization.md. Speeds are in mm/s, times in s.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from agribot.autonomy.estimate.witnesses.slow_creep import CreepMark, SlowCreep

DRIVE_S, ON_S = 300, 100  # length of a drive, time at which the creep begins
CREEPS_MMPS, BIASES_MMPS = (20.0, 15.0, 10.0, 8.3, 6.7, 5.0), (0.0, 1.0, 2.0, 3.0)
# Errors of the preset `rtk`, 1 sigma: of a fix, of its slow part and how long that lasts, of a
# velocity. Period of fixes.
WHITE_M, SLOW_M, SLOW_S, VELOCITY_MPS, PERIOD_S = 0.008, 0.010, 60.0, 0.03, 0.1
FIX_M, WALK_M2_PER_S = math.hypot(0.008, 0.0057), 0.0018**2  # what the filter takes for them
LAPS = 1.0 / PERIOD_S


def draw_drive(rng: np.random.Generator, creep_mps: float, bias_mps: float) -> float | None:
    """Draw one drive; return after which time of the creep it is doubted."""
    watch = SlowCreep()
    slow = SLOW_M * rng.standard_normal(2)
    keep = math.exp(-1.0 / SLOW_S)
    summed = np.zeros(2)
    heading_rad = rng.uniform(0.0, 2.0 * math.pi)
    aside = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    for t_s in range(DRIVE_S):
        crept_m = np.array([creep_mps * max(0, t_s - ON_S), 0.0])
        off_m = slow + WHITE_M * rng.standard_normal(2) + crept_m - summed
        mark = CreepMark(
            float(t_s), complex(*off_m), t_s * LAPS * PERIOD_S**2, 0.4 + 0j, 0.4 * t_s, FIX_M**2
        )
        watch.add(mark, VELOCITY_MPS, WALK_M2_PER_S)
        if watch.doubt is not None:
            return float(t_s - ON_S)
        slow = keep * slow + SLOW_M * math.sqrt(1.0 - keep**2) * rng.standard_normal(2)
        summed = summed + VELOCITY_MPS * PERIOD_S * math.sqrt(LAPS) * rng.standard_normal(2)
        summed = summed + bias_mps * aside
    return None


def main() -> None:
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    rng = np.random.default_rng(5)
    write = sys.stdout.write
    write("| creep | doubted after: median | 90 % |\n|---|---|---|\n")
    for creep in CREEPS_MMPS:
        found = [draw_drive(rng, creep / 1000.0, 0.0) for _ in range(draws)]
        after_s = [math.inf if one is None else one for one in found if one is None or one >= 0.0]
        median_s, most_s = np.quantile(after_s, (0.5, 0.9), method="higher")
        write(f"| {creep:g} | {median_s:.0f} | {most_s:.0f} |\n")
    for bias in BIASES_MMPS:
        doubted = sum(draw_drive(rng, 0.0, bias / 1000.0) is not None for _ in range(draws))
        write(f"no creep, velocities off by {bias:g} for good: {doubted} of {draws} doubted\n")


if __name__ == "__main__":
    main()
