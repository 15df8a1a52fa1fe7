"""Outcomes of many seeds as one line of a table."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from agribot.lab.bench.nav.judge import Outcome
from agribot.lab.bench.nav.scenario import PITCH_M, PLANTS, ROW_LENGTH_M


class LevelLine(msgspec.Struct, frozen=True, kw_only=True):
    """The protection level over all rows; see `judge.LevelOutcome`."""

    row_km: float
    exceeded_per_km: float
    exceeded_ratio: float
    misled_per_km: float
    available_ratio: float


class Line(msgspec.Struct, frozen=True, kw_only=True):
    """`missions_low_ratio` is the lower end of the 95 % interval (Wilson). Errors in metres.

    `xte_rms_m` is over all rows of all missions, `xte_max_m` the worst of all; `cpu_s` is the CPU
    time of all missions.
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
    cpu_s: float
    level: LevelLine | None = None


def line(name: str, outcomes: Sequence[Outcome], rows: int) -> Line:
    """Join the missions of a job in a field of `rows` rows."""
    rms = np.array([o.xte_rms_m for o in outcomes])
    worst = np.array([o.xte_max_m for o in outcomes])
    times, area_m2 = [o.time_s for o in outcomes if o.finished], rows * ROW_LENGTH_M * PITCH_M
    ok = sum(o.success for o in outcomes)
    nees = [o.nees for o in outcomes if o.nees is not None]
    pose = [o.nees_pose for o in outcomes if o.nees_pose is not None]
    return Line(
        name=name,
        missions=len(outcomes),
        missions_ok=ok,
        missions_low_ratio=_wilson_low(ok, len(outcomes)),
        finished_ratio=len(times) / len(outcomes),
        rows_ok_ratio=sum(o.rows_ok for o in outcomes) / (rows * len(outcomes)),
        xte_rms_m=float(np.sqrt(np.mean(rms**2))),
        xte_p95_m=float(np.median([o.xte_p95_m for o in outcomes])),
        xte_max_p90_m=float(np.quantile(worst, 0.9)),
        xte_max_m=float(worst.max()),
        crushed=sum(o.crushed for o in outcomes),
        plants=rows * PLANTS * len(outcomes),
        time_s=float(np.median([o.time_s for o in outcomes])),
        hours_per_ha=float(np.median(times)) / 3600.0 * 1e4 / area_m2 if times else None,
        nees_lateral=float(np.mean(nees)) if nees else None,
        nees_pose=float(np.mean(pose)) if pose else None,
        failed_seeds=tuple(o.seed for o in outcomes if not o.success)[:20],
        worst_seed=outcomes[int(worst.argmax())].seed,
        cpu_s=sum(o.cpu_s for o in outcomes),
        level=_level(outcomes),
    )


def _level(outcomes: Sequence[Outcome]) -> LevelLine | None:
    levels = [outcome.level for outcome in outcomes if outcome.level is not None]
    row_m = sum(level.row_m for level in levels)
    if not row_m:
        return None
    return LevelLine(
        row_km=row_m / 1000.0,
        exceeded_per_km=1000.0 * sum(level.exceeded for level in levels) / row_m,
        exceeded_ratio=sum(level.exceeded_m for level in levels) / row_m,
        misled_per_km=1000.0 * sum(level.misled for level in levels) / row_m,
        available_ratio=sum(level.available_m for level in levels) / row_m,
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
    ("crushed", 9), ("h/ha", 5), ("NEES", 5), ("pose", 5), ("CPU", 6),
)  # fmt: skip


LEVEL_HEADINGS = (
    ("sensors", 34), ("row-km", 8), ("beyond level, 1/km", 18), ("of way", 9),
    ("misled, 1/km", 12), ("available", 9),
)  # fmt: skip


def text(lines: Sequence[Line], *, markdown: bool = False) -> str:
    """Format the table; cross-track errors in centimetres."""
    return _format(HEADINGS, [_cells(entry) for entry in lines], markdown=markdown)


def level_text(lines: Sequence[Line], *, markdown: bool = False) -> str:
    """Format the table of protection levels, of the lines that have them."""
    cells = [_level_cells(entry.name, entry.level) for entry in lines if entry.level is not None]
    return _format(LEVEL_HEADINGS, cells, markdown=markdown)


def _format(
    headings: Sequence[tuple[str, int]], cells: Sequence[list[str]], *, markdown: bool
) -> str:
    rows = [[title for title, _ in headings], *cells]
    if markdown:
        rows.insert(1, ["---"] * len(headings))
        return "\n".join("| " + " | ".join(row) + " |" for row in rows)
    widths = [width for _, width in headings]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def _level_cells(name: str, level: LevelLine) -> list[str]:
    return [
        name,
        f"{level.row_km:.1f}",
        f"{level.exceeded_per_km:.3g}",
        f"{100 * level.exceeded_ratio:.3g} %",
        f"{level.misled_per_km:.3g}",
        f"{100 * level.available_ratio:.4g} %",
    ]


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
        f"{entry.cpu_s:.0f} s",
    ]
