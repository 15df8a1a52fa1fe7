"""Where on a map of plants the plants that were seen may stand, and how likely each place is.

A row of plants looks like the next one, but planters err, plants fail and weeds are hoed out, so
that a few metres of them stand nowhere else in just that way. Every place at which one of the
plants that were seen may be one of the map's is a hypothesis. It is weighed by how many of the
others stand on mapped plants there (a likelihood field: Thrun, Burgard and Fox 2005, Probabilistic
Robotics, 6.4), and by how many that the map has there were in view and were not seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from agribot.autonomy.estimate.filter.stem_map import NO_PLANT, IndexArray, StemMap
from agribot.core.messages import FloatArray

# Distance of a seen plant from its place in the map, 1 sigma: both looks, and the odometry between.
SEEN_STD_M = 0.04
# Probability that a mapped plant in view is seen, and things on a square metre that are taken for
# crop but are not on the map.
SEEN_RATIO, STRAY_PER_M2 = 0.85, 1.0
MATCHED_GAIN = math.log(
    SEEN_RATIO / (1.0 - SEEN_RATIO) / STRAY_PER_M2 / (2.0 * math.pi * SEEN_STD_M**2)
)
MISSED_GAIN = math.log(1.0 - SEEN_RATIO)
# Share of a log likelihood that counts: looks at one field share errors.
SHARE = 0.6
# Places nearer to each other than this are one.
SAME_M, SAME_RAD = 0.1, math.radians(4.0)
ANCHORS, KEPT, CHUNK = 4, 800, 2000
# Probability of a place outside the map's plants, before the robot has seen anything.
ELSEWHERE = 0.01


class SeenPlants(NamedTuple):
    """Plants and squares of ground that were seen, (N, 2) each: from the robot, in map axes."""

    plants_m: FloatArray
    ground_m: FloatArray


class MatchedPlace(NamedTuple):
    """A possible place of the robot, the turn of its heading, and their probability.

    `matched` of the plants that were seen stand on mapped ones there.
    """

    x_map_m: float
    y_map_m: float
    turn_rad: float
    share: float
    matched: int


# Log probabilities of places: x and y on the map, m, and turn of the heading, rad, (N,) each.
Prior = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def find_places(
    plants: StemMap,
    seen: SeenPlants,
    around: tuple[float, float, float] | None,
    turns_rad: Sequence[float],
    prior: Prior | None = None,
) -> list[MatchedPlace]:
    """List the places at which what was seen may have been seen, the likeliest first.

    `around` is a place and how far from it, along each axis, the robot may be; None: anywhere on
    the map. `prior` gives log probabilities of places. What is missing to 1 in the sum of shares is
    that the robot stands nowhere on the map.
    """
    found = np.empty((0, 5))
    for turn_rad in turns_rad:
        turned = _turn(seen, turn_rad)
        places = _list_places(plants, turned.plants_m, around)
        for chunk in np.array_split(places, max(1, len(places) // CHUNK)):
            found = np.vstack([found, _rate(plants, turned, chunk, turn_rad)])
            found = found[np.argsort(-_weigh(found, prior))[:KEPT]]
    best = [
        _refine(plants, _turn(seen, turn_rad), found[found[:, 2] == turn_rad], turn_rad)
        for turn_rad in np.unique(found[:, 2]).tolist()
    ]
    refined = np.vstack(best) if best else found
    return _share_out(refined, _weigh(refined, prior))


def _weigh(rated: FloatArray, prior: Prior | None) -> FloatArray:
    """Give the logarithm of how likely each place is, up to a constant."""
    log: FloatArray = SHARE * rated[:, 3]
    return log if prior is None else log + prior(rated[:, 0], rated[:, 1], rated[:, 2])


def _turn(seen: SeenPlants, turn_rad: float) -> SeenPlants:
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    turn = np.array([[cos, sin], [-sin, cos]])
    return SeenPlants(seen.plants_m @ turn, seen.ground_m @ turn)


def _list_places(
    plants: StemMap, seen_m: FloatArray, around: tuple[float, float, float] | None
) -> FloatArray:
    """List where the robot would stand if some plants that it saw were each one of the map's."""
    picked = np.unique(np.linspace(0, len(seen_m) - 1, min(ANCHORS, len(seen_m))).astype(int))
    places = []
    for anchor in seen_m[picked]:
        if around is None:
            places.append(plants.stems_map_m - anchor)
        else:
            x_m, y_m, reach_m = around
            near = plants.list_near(x_m + anchor[0], y_m + anchor[1], reach_m)
            places.append(near - anchor)
    return np.vstack(places) if places else np.empty((0, 2))


def _rate(plants: StemMap, seen: SeenPlants, places: FloatArray, turn_rad: float) -> FloatArray:
    """Give x, y, turn, log likelihood and matched plants of each place, (N, 5)."""
    gain, _ = _match(plants, seen.plants_m, places)
    ground = places[:, None] + seen.ground_m[None]
    expected = plants.count_in_cells(ground[..., 0], ground[..., 1]).sum(axis=1)
    matched = (gain > 0.0).sum(axis=1)
    missed = np.maximum(expected - matched, 0)
    score = gain.sum(axis=1) + MISSED_GAIN * missed
    return np.column_stack([places, np.full(len(places), turn_rad), score, matched])


def _match(
    plants: StemMap, seen_m: FloatArray, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weigh each seen plant at each place, (N, M), and say how far it stands off its own."""
    at = places[:, None] + seen_m[None]
    nearest = plants.find_nearest(at[..., 0], at[..., 1])
    off_m = at - plants.stems_map_m[nearest]
    off2 = np.where(nearest == NO_PLANT, np.inf, (off_m**2).sum(axis=-1))
    gain: FloatArray = np.maximum(MATCHED_GAIN - off2 / (2.0 * SEEN_STD_M**2), 0.0)
    return gain, off_m


def _refine(plants: StemMap, seen: SeenPlants, places: FloatArray, turn_rad: float) -> FloatArray:
    """Move places by what the plants stand off those of the map there on the average."""
    at = places[:, :2]
    for _ in range(2):
        gain, off_m = _match(plants, seen.plants_m, at)
        weight = (gain > 0.0)[..., None] / np.maximum((gain > 0.0).sum(axis=1), 1)[:, None, None]
        at = at - (weight * off_m).sum(axis=1)
    return _rate(plants, seen, at, turn_rad)


def _share_out(rated: FloatArray, log: FloatArray) -> list[MatchedPlace]:
    """Make probabilities of log likelihoods, and one place of those that are the same."""
    if not len(rated):
        return []
    order = np.argsort(-log)
    distinct = order[_drop_same(rated[order])]
    nowhere = math.log(ELSEWHERE)
    top = max(float(log[order[0]]), nowhere)
    weight = np.exp(log[distinct] - top)
    total = float(weight.sum()) + math.exp(nowhere - top)
    return [
        MatchedPlace(x_m, y_m, turn_rad, w / total, int(matched))
        for (x_m, y_m, turn_rad, _, matched), w in zip(
            rated[distinct].tolist(), weight.tolist(), strict=True
        )
    ]


def _drop_same(rated: FloatArray) -> IndexArray:
    """List the places without those that are one with a place before them."""
    kept, left = list[int](), np.arange(len(rated))
    while len(left):
        first = int(left[0])
        kept.append(first)
        apart_m = np.hypot(*(rated[left, :2] - rated[first, :2]).T)
        is_same = (apart_m < SAME_M) & (np.abs(rated[left, 2] - rated[first, 2]) < SAME_RAD)
        left = left[~is_same]
    return np.array(kept, dtype=np.int32)
