"""Weed maps of several runs and robots become one, whatever comes first and however often."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from agribot.autonomy.weeds.merge import fuse, merge_maps
from agribot.autonomy.weeds.near_pairs import find_near_pairs
from agribot.autonomy.weeds.plant_table import DECISIONS, OUTCOMES, PlantTable, is_crop
from agribot.core.errors import RecordingError
from agribot.core.geo import Datum
from tests.gis.weed_maps import make_map, scatter

STD_M = 0.02


def runs(count: int = 3, seen_ratio: float = 0.97) -> tuple[list[PlantTable], np.ndarray]:
    """Several passes over one field, each missing some plants; and the true places."""
    places_m = scatter(1200, seed=5)
    maps = []
    for number in range(count):
        seen = np.random.default_rng(number).random(len(places_m)) < seen_ratio
        whole = make_map(places_m, f"run {number}", std_m=STD_M, seed=10 + number)
        rows = whole.rows[seen].copy()
        rows["group"] = np.arange(len(rows))
        maps.append(whole._replace(rows=rows))
    return maps, places_m


def same(one: PlantTable, other: PlantTable) -> bool:
    return one.maps == other.maps and one.rows.tobytes() == other.rows.tobytes()


def test_two_passes_find_95_percent_again_and_the_merged_place_is_within_5_cm() -> None:
    maps, places_m = runs(2, seen_ratio=0.985)
    merged = merge_maps(maps)
    counts = np.bincount(merged.rows["group"])
    in_both = set(maps[0].rows["id"]) & set(maps[1].rows["id"])
    assert (counts == 2).sum() >= 0.95 * len(in_both)
    plants = fuse(merged).rows
    error_m = np.hypot(
        plants["x_map_m"] - places_m[plants["id"] - 1, 0],
        plants["y_map_m"] - places_m[plants["id"] - 1, 1],
    )
    assert np.quantile(error_m, 0.95) <= 0.05


def test_a_plant_that_two_maps_have_is_never_joined_with_its_neighbour() -> None:
    maps, _ = runs(3)
    merged = merge_maps(maps)
    for group in np.flatnonzero(np.bincount(merged.rows["group"]) > 1):
        members = merged.rows[merged.rows["group"] == group]
        assert len(set(members["id"])) == 1
        assert len(set(members["map"])) == len(members)


def test_the_order_of_the_maps_does_not_matter() -> None:
    maps, _ = runs(3)
    wanted = merge_maps(maps)
    assert all(same(merge_maps(order), wanted) for order in itertools.permutations(maps))


def test_merging_again_changes_nothing() -> None:
    maps, _ = runs(3)
    merged = merge_maps(maps)
    assert same(merge_maps([merged]), merged)
    assert same(merge_maps([merged, maps[1], merged]), merged)
    assert same(merge_maps([merge_maps(maps[:2]), maps[2]]), merged)
    assert same(merge_maps([maps[0], maps[0]]), maps[0])


def test_an_earlier_state_of_a_map_adds_nothing_to_a_later_one() -> None:
    (later, *_), _ = runs(1)
    earlier = later._replace(rows=later.rows[:300].copy())
    earlier.rows["sightings"] -= 1
    earlier.rows["last_seen_s"] -= 1.0
    assert same(merge_maps([earlier, later]), merge_maps([later]))


def test_the_stated_covariance_of_a_merged_place_is_not_smaller_than_its_error() -> None:
    maps, places_m = runs(3, seen_ratio=1.0)
    merged = merge_maps(maps)
    plants = fuse(merged).rows[np.bincount(merged.rows["group"]) == 3]
    dx, dy = (
        np.column_stack([plants["x_map_m"], plants["y_map_m"]]).T - places_m[plants["id"] - 1].T
    )
    xx, xy, yy = plants["xx_m2"], plants["xy_m2"], plants["yy_m2"]
    nees = (dx * dx * yy - 2 * dx * dy * xy + dy * dy * xx) / (xx * yy - xy * xy)
    assert nees.mean() < 2.0 * 1.1
    assert np.hypot(dx, dy).mean() < 0.8 * STD_M * np.sqrt(np.pi / 2)  # better than one pass


def test_plants_nearer_than_their_uncertainty_stay_as_many_as_each_map_has() -> None:
    places_m = np.array([[0.0, 0.0], [0.06, 0.0], [0.12, 0.0]])
    merged = merge_maps([make_map(places_m, n, std_m=0.02, seed=s) for s, n in enumerate("ab")])
    assert np.bincount(merged.rows["group"]).tolist() == [2, 2, 2]


def test_more_evidence_decides_the_class_and_a_tie_is_crop() -> None:
    weed, crop = (make_map(np.array([[1.0, 1.0]]), name) for name in "ab")
    for table, plant, confidence in ((weed, 0, 0.7), (crop, 1, 0.9)):
        table.rows["plant"], table.rows["confidence"] = plant, confidence
    assert is_crop(fuse(merge_maps([weed, crop])).rows).tolist() == [True]
    weed.rows["confidence"] = 0.9
    assert is_crop(fuse(merge_maps([weed, crop])).rows).tolist() == [True]
    weed.rows["confidence"] = 0.95
    assert is_crop(fuse(merge_maps([weed, crop])).rows).tolist() == [False]


def test_a_weed_that_one_of_two_robots_treated_is_treated() -> None:
    one, other = (make_map(np.array([[0, 0], [1.0, 1.0]]), name) for name in "ab")
    for table, outcome in ((one, "missed"), (other, "treated")):
        table.rows["plant"], table.rows["decision"] = 0, DECISIONS.index("treat")
        table.rows["outcome"] = OUTCOMES.index(outcome)
    plants = fuse(merge_maps([one, other])).rows
    assert [OUTCOMES[code] for code in plants["outcome"]] == ["treated", "treated"]


def test_maps_of_one_name_with_swapped_ids_are_refused() -> None:
    (table, *_), _ = runs(1)
    swapped = table.rows.copy()
    swapped["id"] = swapped["id"][::-1]
    with pytest.raises(RecordingError, match=r"two maps are named run 0.*ids are swapped"):
        merge_maps([table, table._replace(rows=swapped)])


def test_maps_whose_classes_are_swapped_are_refused() -> None:
    (one, other), _ = runs(2)
    swapped = other.rows.copy()
    swapped["plant"] = 1 - swapped["plant"]
    swapped["confidence"] = one.rows["confidence"][0] = 0.55
    with pytest.raises(RecordingError, match=r"weed and crop are swapped"):
        merge_maps([one, other._replace(rows=swapped)])


def test_maps_of_fields_far_apart_are_refused() -> None:
    (one, other), _ = runs(2)
    with pytest.raises(RecordingError, match=r"km apart"):
        merge_maps([one, other._replace(datum=Datum(lat_deg=48.0, lon_deg=11.6))])


def test_near_pairs_are_those_that_a_comparison_of_all_finds() -> None:
    places_m = np.random.default_rng(3).uniform(-2.0, 2.0, (400, 2))
    i, j = find_near_pairs(places_m, 0.15)
    gap_m = np.hypot(*(places_m[:, None] - places_m[None, :]).transpose(2, 0, 1))
    wanted = {(int(a), int(b)) for a, b in zip(*np.nonzero(np.triu(gap_m <= 0.15, 1)), strict=True)}
    assert {(min(a, b), max(a, b)) for a, b in zip(i.tolist(), j.tolist(), strict=True)} == wanted
    assert len(i) == len(wanted)
