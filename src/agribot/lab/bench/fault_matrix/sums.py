"""What the matrix found as a whole, in the keys of `--json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from agribot.lab.bench.fault_matrix.cells import PRESET, Cell
from agribot.lab.bench.fault_matrix.driving import CellResult
from agribot.lab.bench.fault_matrix.verdict import CellVerdict

PRESSED = "stop_to_clear"  # code of a stop that an operator pressed


def summarise(
    verdicts: Sequence[CellVerdict], results: Mapping[Cell, CellResult], lost: Sequence[Cell]
) -> dict[str, Any]:
    """Sum up all cells. Ratios are over the cells whose fault began."""
    begun = [verdict for verdict in verdicts if verdict.began]
    references = [result for cell, result in results.items() if not cell.fault]
    plants = sum(verdict.plants for verdict in verdicts)
    harmful = [verdict for verdict in begun if not verdict.is_harmless]
    return {
        "preset": PRESET,
        "cells": len(verdicts),
        "pairs": sum(bool(verdict.also) for verdict in verdicts),
        "faults": len({verdict.fault for verdict in verdicts}),
        "states": len({verdict.state for verdict in verdicts}),
        "seeds": len({verdict.seed for verdict in verdicts}),
        "never_began": len(verdicts) - len(begun) + len(lost),
        "detected_ratio": _divide(sum(v.noticed_s is not None for v in begun), len(begun)),
        "named_ratio": _divide(sum(v.is_named for v in begun), len(begun)),
        "one_of_two_ratio": _divide(
            sum(v.is_one_of_two and not v.is_named for v in begun), len(begun)
        ),
        "harmless": len(begun) - len(harmful),
        "harmful_detected_ratio": _divide(
            sum(v.noticed_s is not None for v in harmful), len(harmful)
        ),
        "harmful_named_ratio": _divide(sum(v.is_named for v in harmful), len(harmful)),
        "accused_first": sum(bool(verdict.accused) for verdict in verdicts),
        "crushed": sum(verdict.crushed for verdict in verdicts),
        "crushed_after_detectable": sum(verdict.crushed_noticeable for verdict in verdicts),
        "crushed_after_noticed": sum(verdict.crushed_noticed for verdict in verdicts),
        "crushed_ratio": _divide(sum(verdict.crushed for verdict in verdicts), plants),
        "outside_m_max": max((verdict.outside_m for verdict in verdicts), default=None),
        "rolled_m_max": max((verdict.rolled_m for verdict in verdicts), default=None),
        "stops_too_long": sum(verdict.stops_too_long for verdict in verdicts),
        "over_level_ratio": _divide(sum(v.over_level_ratio for v in verdicts), len(verdicts)),
        "over_level_ratio_max": max((v.over_level_ratio for v in verdicts), default=None),
        "cells_over_level": sum(v.over_level_ratio > 0.0 for v in verdicts),
        "red": sum(bool(verdict.red) for verdict in verdicts),
        "ended_badly": sum(bool(verdict.error) for verdict in verdicts),
        "false_stops": sum(map(count_false_stops, references)),
        "missions_without_fault": len(references),
        "km_without_fault": sum(result.km for result in references),
        "cpu_s": sum(result.cpu_s for result in results.values()),
        "rows": msgspec.to_builtins(verdicts),
    }


def count_false_stops(reference: CellResult) -> int:
    """Count the stops that no operator pressed, and a mission that failed."""
    stops = sum(event.kind == "stop" and event.code != PRESSED for event in reference.events)
    return stops + any(event.state == "failed" for event in reference.events)


def _divide(part: float, whole: float) -> float | None:
    return part / whole if whole else None
