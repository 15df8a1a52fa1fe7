"""Outcomes of many seeds as one line of a table."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.lab.bench.nav.judge import Outcome
from agribot.lab.bench.nav.scenario import AREA_M2, PLANTS, ROWS


class Line(msgspec.Struct, frozen=True, kw_only=True):
    """`missions_low_ratio` is the lower end of the 95 % interval (Wilson). Errors in metres.

    `xte_rms_m` is over all rows of all missions, `xte_max_m` the worst of all.
    """

    name: str
    missions: int
    missions_ok: int
    missions_low_ratio: float
    finished_ratio: float
    rows_ok_ratio: float
    xte_rms_m: float
    xte_p95_m: float
    xte_max_p90_m: float
    xte_max_m: float
    crushed: int
    plants: int
    time_s: float
    hours_per_ha: float | None
    nees_lateral: float | None
    nees_pose: float | None
    failed_seeds: tuple[int, ...]
    worst_seed: int  # the mission of `xte_max_m`


def line(name: str, outcomes: Sequence[Outcome]) -> Line:
    rms = np.array([o.xte_rms_m for o in outcomes])
    worst = np.array([o.xte_max_m for o in outcomes])
    times = [o.time_s for o in outcomes if o.finished]
    ok = sum(o.success for o in outcomes)
    nees = [o.nees for o in outcomes if o.nees is not None]
    pose = [o.nees_pose for o in outcomes if o.nees_pose is not None]
    return Line(
        name=name,
        missions=len(outcomes),
        missions_ok=ok,
        missions_low_ratio=_wilson_low(ok, len(outcomes)),
        finished_ratio=len(times) / len(outcomes),
        rows_ok_ratio=sum(o.rows_ok for o in outcomes) / (ROWS * len(outcomes)),
        xte_rms_m=float(np.sqrt(np.mean(rms**2))),
        xte_p95_m=float(np.median([o.xte_p95_m for o in outcomes])),
        xte_max_p90_m=float(np.quantile(worst, 0.9)),
        xte_max_m=float(worst.max()),
        crushed=sum(o.crushed for o in outcomes),
        plants=ROWS * PLANTS * len(outcomes),
        time_s=float(np.median([o.time_s for o in outcomes])),
        hours_per_ha=float(np.median(times)) / 3600.0 * 1e4 / AREA_M2 if times else None,
        nees_lateral=float(np.mean(nees)) if nees else None,
        nees_pose=float(np.mean(pose)) if pose else None,
        failed_seeds=tuple(o.seed for o in outcomes if not o.success)[:20],
        worst_seed=outcomes[int(worst.argmax())].seed,
    )


def _wilson_low(ok: int, total: int) -> float:
    z2 = 1.96**2
    share = ok / total
    centre = share + z2 / (2 * total)
    return (centre - 1.96 * math.sqrt((share * (1 - share) + z2 / (4 * total)) / total)) / (
        1 + z2 / total
    )


HEADINGS = (
    ("sensors", 34), ("missions", 11), ("rows", 6), ("XTE RMS", 8), ("p95", 7), ("max", 7),
    ("crushed", 9), ("h/ha", 5), ("NEES", 5), ("pose", 5),
)  # fmt: skip


def text(lines: Sequence[Line], *, markdown: bool = False) -> str:
    """Format the table; cross-track errors in centimetres."""
    widths = [width for _, width in HEADINGS]
    rows = [[title for title, _ in HEADINGS]]
    rows += [_cells(entry) for entry in lines]
    if markdown:
        rows.insert(1, ["---"] * len(HEADINGS))
        return "\n".join("| " + " | ".join(row) + " |" for row in rows)
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def _cells(entry: Line) -> list[str]:
    return [
        entry.name,
        f"{entry.missions_ok} of {entry.missions}",
        f"{100 * entry.rows_ok_ratio:.4g} %",
        f"{100 * entry.xte_rms_m:.2f} cm",
        f"{100 * entry.xte_p95_m:.1f} cm",
        f"{100 * entry.xte_max_m:.1f} cm",
        f"{100 * entry.crushed / entry.plants:.3g} %",
        "-" if entry.hours_per_ha is None else f"{entry.hours_per_ha:.2f}",
        "-" if entry.nees_lateral is None else f"{entry.nees_lateral:.2f}",
        "-" if entry.nees_pose is None else f"{entry.nees_pose:.2f}",
    ]
