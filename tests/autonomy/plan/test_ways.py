"""Shortest ways around obstacles."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from agribot.autonomy.plan.coverage.area import FieldArea, MapLine
from agribot.autonomy.plan.coverage.free_space import FreeSpace
from agribot.autonomy.plan.coverage.planner import plan_field
from agribot.autonomy.plan.coverage.ways import Ways
from agribot.core.messages import FloatArray, MapPoint
from tests.autonomy.plan.fields import REQUEST, SHAPE


def islands(count: int, width_m: float, depth_m: float, seed: int = 0) -> FieldArea:
    """A rectangle with round trees that the robot can pass between."""
    rng, holes = np.random.default_rng(seed), list[shapely.Polygon]()
    while len(holes) < count:
        centre = shapely.Point(rng.uniform((3.0, 3.0), (width_m - 3.0, depth_m - 3.0)))
        tree = centre.buffer(rng.uniform(0.3, 1.2), quad_segs=2)
        if all(tree.distance(other) > 2.5 for other in holes):
            holes.append(tree)
    boundary = ((0.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m))
    return FieldArea(boundary=boundary, holes=tuple(map(ring, holes)))


def ring(polygon: shapely.Polygon) -> MapLine:
    return tuple((x_m, y_m) for x_m, y_m in polygon.exterior.coords[:-1])


def find_shortest_m(space: FreeSpace, start: MapPoint, end: MapPoint) -> float:
    """Floyd and Warshall over all corners, whatever way the outline leads there."""
    places = np.concatenate([[start, end], shapely.get_coordinates(space.region)])
    first, second = np.triu_indices(len(places), 1)
    lines = np.asarray(shapely.linestrings(np.stack([places[first], places[second]], axis=1)))
    length_m: FloatArray = np.full((len(places), len(places)), math.inf)
    is_seen = shapely.covers(space.drivable, lines)
    length_m[first[is_seen], second[is_seen]] = shapely.length(lines[is_seen])
    length_m = np.minimum(length_m, length_m.T)
    for middle in range(len(places)):
        length_m = np.minimum(length_m, length_m[:, middle, None] + length_m[None, middle])
    return float(length_m[0, 1])


@pytest.mark.parametrize("seed", range(4))
def test_a_way_around_obstacles_is_as_short_as_one_over_all_their_corners(seed: int) -> None:
    space = FreeSpace(islands(5, 16.0, 12.0, seed), SHAPE, REQUEST)
    ways, rng = Ways(space.region, space.drivable), np.random.default_rng(seed)
    for _ in range(4):
        start, end = (
            space.nearest((x, y)) for x, y in rng.uniform((0.0, 0.0), (16.0, 12.0), (2, 2))
        )
        found = ways.way(start, end)
        assert found[0] == start and found[-1] == end
        length_m = sum(math.dist(a, b) for a, b in pairwise(found))
        assert length_m == pytest.approx(find_shortest_m(space, start, end), abs=2e-3)
        assert all(ways.is_open(a, b) for a, b in pairwise(found))


def test_a_field_of_many_trees_is_planned_without_looking_from_every_corner_to_every_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Some 380,000 lines were checked, most of the 10 CPU seconds that 40 trees took."""
    checked = []
    find_covered = Ways._find_covered

    def count(self: Ways, starts: FloatArray, ends: FloatArray) -> FloatArray:
        checked.append(len(starts))
        return find_covered(self, starts, ends)

    monkeypatch.setattr(Ways, "_find_covered", count)
    plan_field(islands(40, 100.0, 70.0), SHAPE, REQUEST)
    assert 0 < sum(checked) < 15_000
