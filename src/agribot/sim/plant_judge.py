"""Comparison of a map of plants with those that truly stand in the field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from agribot.core.messages import FloatArray, MappedPlant, PlantClass, Row
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.core.world import Plant

MATCH_RADIUS_M = 0.10  # a mapped plant farther from every true one is a false alarm


class Matches(NamedTuple):
    """True and mapped plants in the strips of rows, and how well they fit each other."""

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


def match_plants(
    kind: PlantClass,
    mapped: Sequence[MappedPlant],
    plants: Sequence[Plant],
    rows: Sequence[Row],
    pitch_m: float,
) -> Matches:
    """Match mapped to true plants of class `kind` in strips of width `pitch_m` along `rows`.

    `mapped` are those that the map calls `kind`; `plants` are all true ones, of any class.
    """
    alike = [p for p in plants if p.plant == kind]
    truth = [p for p in alike if _is_in_strips(p.x_map_m, p.y_map_m, rows, pitch_m)]
    inside = [m for m in mapped if _is_in_strips(m.x_map_m, m.y_map_m, rows, pitch_m)]
    distances_m = _match(inside, alike)
    return Matches(
        truth=len(truth),
        mapped=len(inside),
        precision=len(distances_m) / len(inside) if inside else None,
        recall=len(_match(mapped, truth)) / len(truth) if truth else None,
        distances_m=distances_m,
    )


def find_percentile(values: Sequence[float], percent: float) -> float | None:
    """Return the percentile of `values`, between them by a straight line; None without any."""
    return float(np.percentile(values, percent)) if len(values) else None


def _is_in_strips(x_m: float, y_m: float, rows: Sequence[Row], pitch_m: float) -> bool:
    for row in rows:
        along_m, across_m, _ = project_on_row(row, x_m, y_m)
        if 0.0 <= along_m <= row_length_m(row) and abs(across_m) <= pitch_m / 2:
            return True
    return False


def _match(mapped: Sequence[MappedPlant], truth: Sequence[Plant]) -> list[float]:
    """Return the distances of the one-to-one pairs within MATCH_RADIUS_M (Hungarian method).

    Each group of plants that are linked by such pairs is matched by itself: a whole field of crops
    has thousands, and one table of all their distances would not fit the memory.
    """
    if not mapped or not truth:
        return []
    mapped_xy = np.array([(m.x_map_m, m.y_map_m) for m in mapped])
    truth_xy = np.array([(p.x_map_m, p.y_map_m) for p in truth])
    near = cKDTree(mapped_xy).query_ball_point(truth_xy, MATCH_RADIUS_M)
    pairs = [(m, t) for t, found in enumerate(near) for m in found]
    if not pairs:
        return []
    of_mapped, of_truth = np.array(pairs).T
    size = len(mapped) + len(truth)
    links = coo_array((np.ones(len(pairs)), (of_mapped, of_truth + len(mapped))), (size, size))
    group = connected_components(links, directed=False)[1]
    distances_m: list[float] = []
    for number in np.unique(group[of_mapped]):
        one = np.flatnonzero(group[: len(mapped)] == number)
        other = np.flatnonzero(group[len(mapped) :] == number)
        distances_m += _match_group(mapped_xy[one], truth_xy[other])
    return distances_m


def _match_group(mapped_m: FloatArray, truth_m: FloatArray) -> list[float]:
    """Match (N, 2) to (M, 2): as many pairs as there can be, and of those the nearest."""
    distance = np.linalg.norm(mapped_m[:, None] - truth_m[None], axis=2)
    cost = np.where(distance <= MATCH_RADIUS_M, distance, 1e3)
    chosen = linear_sum_assignment(cost)
    return [float(d) for d in distance[chosen] if d <= MATCH_RADIUS_M]
