"""How a map of plants is matched with the plants that truly stand along rows."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.core.messages import MappedPlant, PlantClass, Row
from agribot.core.world import Plant
from agribot.sim.plant_judge import MATCH_RADIUS_M, Matches, find_percentile, match_plants

ROW = Row(index=0, start_map_m=(0.0, 0.0), end_map_m=(10.0, 0.0))
CROP, WEED = PlantClass.CROP, PlantClass.WEED


def _stand(x_m: float, y_m: float, kind: PlantClass = CROP) -> Plant:
    return Plant(
        species="sugar_beet", plant=kind, x_map_m=x_m, y_map_m=y_m, yaw_rad=0.0, size_m=0.1,
        seed=1, stem_radius_m=0.01,
    )  # fmt: skip


def _map(x_m: float, y_m: float, kind: PlantClass = CROP) -> MappedPlant:
    return MappedPlant(
        id=1, x_map_m=x_m, y_map_m=y_m, cov_m2=(1e-4, 0.0, 0.0, 1e-4), plant=kind, confidence=0.9,
        sightings=3, first_seen_s=0.0, last_seen_s=1.0, treated_s=None, area_m2=0.01,
    )  # fmt: skip


def _match(mapped: list[MappedPlant], plants: list[Plant], kind: PlantClass = CROP) -> Matches:
    return match_plants(kind, mapped, plants, [ROW], 1.0)


def test_crops_are_matched_with_crops_and_weeds_with_weeds() -> None:
    plants = [_stand(1.0, 0.0), _stand(2.0, 0.0), _stand(2.05, 0.0, WEED)]
    crops = _match([_map(1.03, 0.0), _map(2.06, 0.0)], plants)
    assert (crops.truth, crops.mapped, crops.recall, crops.precision) == (2, 2, 1.0, 1.0)
    assert crops.distances_m == pytest.approx([0.03, 0.06])
    weeds = _match([_map(2.06, 0.0, WEED)], plants, WEED)
    assert weeds.distances_m == pytest.approx([0.01])


def test_plants_beside_the_strips_and_behind_their_ends_do_not_count() -> None:
    places = [(5.0, 0.4), (5.0, 0.6), (10.2, 0.0), (-0.2, 0.0)]
    found = _match([_map(*place) for place in places], [_stand(*place) for place in places])
    assert (found.truth, found.mapped, len(found.distances_m)) == (1, 1, 1)


def test_two_mapped_plants_on_one_true_one_are_one_hit() -> None:
    found = _match([_map(1.0, 0.01), _map(1.0, -0.02)], [_stand(1.0, 0.0)])
    assert (found.precision, found.recall) == (0.5, 1.0)
    assert found.distances_m == pytest.approx([0.01])


def test_a_touching_row_is_matched_as_a_whole_and_like_one_big_table() -> None:
    rng = np.random.default_rng(3)
    along_m = np.arange(0.2, 9.8, 0.06)
    shift_m = rng.normal(0.0, 0.02, (len(along_m), 2))
    plants = [_stand(float(x), 0.0) for x in along_m]
    mapped = [_map(float(x + dx), float(dy)) for x, (dx, dy) in zip(along_m, shift_m, strict=True)]
    found = _match(mapped, plants)
    assert found.recall == found.precision == 1.0
    assert np.mean(found.distances_m) <= np.hypot(*shift_m.T).mean() + 1e-9
    assert max(found.distances_m) <= MATCH_RADIUS_M


def test_what_was_not_measured_has_no_percentile() -> None:
    assert find_percentile([], 95.0) is None
    assert find_percentile([0.0, 0.02], 50.0) == pytest.approx(0.01)
    nothing = _match([], [_stand(1.0, 0.0)])
    assert (nothing.precision, nothing.recall, nothing.distances_m) == (None, 0.0, [])
