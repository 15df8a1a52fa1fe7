"""Comparison of a map of plants with those that truly stand in the field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from agribot.core.messages import FloatArray, MappedPlant, PlantClass, Row
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.core.world import Plant

MATCH_RADIUS_M = 0.10  # distance from every true plant beyond which a mapped one is a false alarm
FAR = 1e3  # a sum larger than all near pairs of a group together
Pairs = npt.NDArray[np.intp]


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
    truth = [p for p in alike if is_in_strips(p.x_map_m, p.y_map_m, rows, pitch_m)]
    inside = [m for m in mapped if is_in_strips(m.x_map_m, m.y_map_m, rows, pitch_m)]
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


def is_in_strips(x_m: float, y_m: float, rows: Sequence[Row], pitch_m: float) -> bool:
    """Return whether a place lies in one of the strips of width `pitch_m` along rows."""
    for row in rows:
        along_m, across_m, _ = project_on_row(row, x_m, y_m)
        if 0.0 <= along_m <= row_length_m(row) and abs(across_m) <= pitch_m / 2:
            return True
    return False


def _match(mapped: Sequence[MappedPlant], truth: Sequence[Plant]) -> list[float]:
    """Return the distances of the one-to-one pairs within MATCH_RADIUS_M."""
    mapped_m = np.array([(m.x_map_m, m.y_map_m) for m in mapped]).reshape(-1, 2)
    truth_m = np.array([(p.x_map_m, p.y_map_m) for p in truth]).reshape(-1, 2)
    pairs = find_pairs(mapped_m, truth_m, MATCH_RADIUS_M)
    distances_m: list[float] = np.hypot(*(mapped_m[pairs[:, 0]] - truth_m[pairs[:, 1]]).T).tolist()
    return distances_m


def find_pairs(places_m: FloatArray, others_m: FloatArray, radius_m: float) -> Pairs:
    """Pair places (N, 2) with others (M, 2), one to one, none farther apart than `radius_m`.

    There are as many pairs as there can be, and of those the nearest (Hungarian method). Returns
    the indices of the pairs, (K, 2). Each group of places that are linked by such pairs is matched
    by itself: a whole field has thousands, and a table of all distances would not fit the memory.
    """
    from scipy.optimize import linear_sum_assignment
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    none: Pairs = np.zeros((0, 2), dtype=np.intp)
    if not len(places_m) or not len(others_m):
        return none
    near = cKDTree(places_m).sparse_distance_matrix(cKDTree(others_m), radius_m)
    ends = np.array(list(near.keys())).reshape(-1, 2) + np.array((0, len(places_m)))
    if not len(ends):
        return none
    size = len(places_m) + len(others_m)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (size, size))
    group = connected_components(graph, directed=False)[1]
    pairs = []
    for number in np.unique(group[ends[:, 0]]):
        one = np.flatnonzero(group[: len(places_m)] == number)
        other = np.flatnonzero(group[len(places_m) :] == number)
        distance = np.linalg.norm(places_m[one, None] - others_m[None, other], axis=2)
        chosen = linear_sum_assignment(np.where(distance <= radius_m, distance, FAR))
        is_near = distance[chosen] <= radius_m
        pairs.append(np.column_stack([one[chosen[0]], other[chosen[1]]])[is_near])
    return np.concatenate(pairs)
