"""Comparison of a weed map with the true weeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from agribot.core.messages import MappedPlant, PlantClass, Row
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.core.world import Plant

MATCH_RADIUS_M = 0.10  # a mapped weed farther from every true one is a false alarm


class Matches(NamedTuple):
    """True and mapped weeds in the strips of rows, and how well they fit each other."""

    truth: int
    mapped: int
    precision: float | None
    recall: float | None
    distances_m: list[float]

    @property
    def f1(self) -> float | None:
        precision, recall = self.precision, self.recall
        if precision is None or recall is None:
            return None
        return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def match_weeds(
    mapped: Sequence[MappedPlant], plants: Sequence[Plant], rows: Sequence[Row], pitch_m: float
) -> Matches:
    """Match mapped to true weeds in strips of width `pitch_m` along `rows`.

    `plants` are all true ones, of any class.
    """
    weeds = [p for p in plants if p.plant == PlantClass.WEED]
    truth = [p for p in weeds if _is_in_strips(p.x_map_m, p.y_map_m, rows, pitch_m)]
    inside = [m for m in mapped if _is_in_strips(m.x_map_m, m.y_map_m, rows, pitch_m)]
    distances_m = _match(inside, weeds)
    return Matches(
        truth=len(truth),
        mapped=len(inside),
        precision=len(distances_m) / len(inside) if inside else None,
        recall=len(_match(mapped, truth)) / len(truth) if truth else None,
        distances_m=distances_m,
    )


def _is_in_strips(x_m: float, y_m: float, rows: Sequence[Row], pitch_m: float) -> bool:
    for row in rows:
        along_m, across_m, _ = project_on_row(row, x_m, y_m)
        if 0.0 <= along_m <= row_length_m(row) and abs(across_m) <= pitch_m / 2:
            return True
    return False


def _match(mapped: Sequence[MappedPlant], truth: Sequence[Plant]) -> list[float]:
    """Return the distances of the one-to-one pairs within MATCH_RADIUS_M (Hungarian method)."""
    if not mapped or not truth:
        return []
    mapped_xy = np.array([(m.x_map_m, m.y_map_m) for m in mapped])
    truth_xy = np.array([(p.x_map_m, p.y_map_m) for p in truth])
    distance = np.linalg.norm(mapped_xy[:, None] - truth_xy[None], axis=2)
    cost = np.where(distance <= MATCH_RADIUS_M, distance, 1e3)
    pairs = linear_sum_assignment(cost)
    return [float(d) for d in distance[pairs] if d <= MATCH_RADIUS_M]
