from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import pytest

from agribot.autonomy.weeds.map import WeedMap
from agribot.autonomy.weeds.track import Track
from agribot.core.config import WeedConfig
from agribot.core.messages import GroundPlant, PlantClass
from tests.autonomy.weeds.weed_field import make_estimate, make_scene

WEED, CROP = PlantClass.WEED, PlantClass.CROP
FRAME_S = 0.1
BIG_M, BIG_RADIUS_M = (0.8, 0.0), 0.12


def make_plant(x_m: float, y_m: float, plant: PlantClass, radius_m: float) -> GroundPlant:
    return GroundPlant(
        x_body_m=x_m, y_body_m=y_m, plant=plant, area_m2=math.pi * radius_m**2,
        confidence=0.85, std_m=0.01,
    )  # fmt: skip


BIG = make_plant(*BIG_M, CROP, BIG_RADIUS_M)


def look(weed_map: WeedMap, frames: range, seen: Callable[[int], tuple[GroundPlant, ...]]) -> None:
    """Let a robot standing at the map's origin see plants in these frames."""
    for index in frames:
        t_s = FRAME_S * index
        weed_map.track_pose(make_estimate(t_s, 0.0, 0.0, 0.0, v_mps=0.0))
        weed_map.add(make_scene(t_s, seen(index), view=()))


def see(second: GroundPlant, every: int, frames: int = 24, since: int = 0) -> WeedMap:
    """Let a robot see `BIG` in all frames and `second` in some of those from `since` on."""
    weed_map = WeedMap(WeedConfig())
    look(
        weed_map,
        range(frames),
        lambda index: (BIG, second) if index >= since and index % every == 0 else (BIG,),
    )
    return weed_map


def beside(gap_m: float, plant: PlantClass = CROP) -> GroundPlant:
    return make_plant(BIG_M[0], BIG_M[1] + gap_m, plant, 0.03)


@pytest.mark.parametrize("frames", [12, 24, 48])
def test_a_stem_seen_at_times_under_the_leaves_of_its_own_class_is_no_plant(frames: int) -> None:
    (crop,) = see(beside(0.08), every=4, frames=frames).crops()
    assert (crop.x_map_m, crop.y_map_m) == pytest.approx(BIG_M, abs=1e-9)
    assert crop.sightings == frames


def test_a_weed_under_the_leaves_of_a_crop_stays_however_seldom_it_is_seen() -> None:
    weed_map = see(beside(0.08, WEED), every=4)
    assert len(weed_map.crops()) == len(weed_map.weeds()) == 1


def test_plants_that_are_seen_side_by_side_in_every_frame_are_two() -> None:
    assert len(see(beside(0.08), every=1).crops()) == 2


def test_a_plant_that_comes_into_view_late_under_the_leaves_of_another_stays() -> None:
    weed_map = WeedMap(WeedConfig())
    look(weed_map, range(20), lambda _: (BIG,))
    for index in range(20, 30):
        look(weed_map, range(index, index + 1), lambda _: (BIG, beside(0.08)))
        assert len(weed_map.plants()) == 2


def test_a_seldom_plant_beside_the_leaves_of_another_one_stays() -> None:
    assert len(see(beside(0.1), every=4).crops()) == 2


def test_a_big_plant_that_is_found_late_does_not_swallow_a_small_one() -> None:
    weed_map = WeedMap(WeedConfig())
    small = beside(0.08)
    look(weed_map, range(10), lambda _: (small,))
    look(weed_map, range(10, 30), lambda index: (BIG,) if index % 2 else (BIG, small))
    assert len(weed_map.crops()) == 2


def test_a_stem_that_shows_only_once_the_plant_has_left_the_view_is_no_plant() -> None:
    weed_map = WeedMap(WeedConfig())
    look(weed_map, range(20), lambda _: (BIG,))
    look(weed_map, range(25, 29), lambda _: (beside(0.088),))
    assert [plant.sightings for plant in weed_map.plants()] == [20]


def test_a_double_that_was_treated_is_not_forgotten() -> None:
    weed_map = WeedMap(WeedConfig())
    look(weed_map, range(4), lambda _: (BIG, beside(0.08)))
    _, double = weed_map.crops()
    weed_map.mark_treated(double.id, 0.4)
    look(weed_map, range(4, 30), lambda _: (BIG,))
    assert double.id in [crop.id for crop in weed_map.crops()]


def test_weeds_that_one_picture_showed_apart_stay_as_many_whatever_later_ones_show() -> None:
    """Three weeds 5 cm apart; after three pictures the network makes two of them, then one."""
    weeds = [make_plant(BIG_M[0], y_m, WEED, 0.02) for y_m in (-0.05, 0.0, 0.05)]
    joined = [make_plant(BIG_M[0], y_m, WEED, 0.03) for y_m in (-0.025, 0.025)]
    weed_map = WeedMap(WeedConfig())
    look(weed_map, range(3), lambda _: tuple(weeds))
    look(weed_map, range(3, 30), lambda _: tuple(joined))
    look(weed_map, range(30, 60), lambda _: (weeds[1],))
    assert len(weed_map.weeds()) == 3


def test_weeds_seen_apart_stay_two_in_the_map_of_the_run_that_goes_on() -> None:
    weeds = [make_plant(BIG_M[0], y_m, WEED, 0.02) for y_m in (-0.04, 0.04)]
    before = WeedMap(WeedConfig())
    look(before, range(6), lambda _: tuple(weeds))
    tracks = msgspec.json.decode(msgspec.json.encode(before.tracks), type=tuple[Track, ...])
    again = WeedMap(WeedConfig())
    again.restore(tracks)
    look(again, range(6, 30), lambda index: (make_plant(BIG_M[0], 0.0, WEED, 0.02),))
    assert len(again.weeds()) == 2


def drift(weed_map: WeedMap, frames: range, from_y_m: float, to_y_m: float) -> None:
    """Let a robot see one weed come nearer by 1 cm from picture to picture."""
    look(
        weed_map,
        frames,
        lambda index: (
            make_plant(BIG_M[0], max(to_y_m, from_y_m - 0.01 * (index - frames[0])), WEED, 0.02),
        ),
    )


@pytest.mark.parametrize("order", [1, -1])
def test_a_weed_that_is_joined_to_another_one_stays_apart_from_its_neighbour(order: int) -> None:
    """One is seen once and badly, then two side by side, which seem to come nearer one by one."""
    weed_map = WeedMap(WeedConfig())
    lone = msgspec.structs.replace(make_plant(BIG_M[0], 0.0, WEED, 0.02), std_m=0.05)
    look(weed_map, range(1), lambda _: (lone,))
    pair = [make_plant(BIG_M[0], y_m, WEED, 0.02) for y_m in (0.19, 0.24)][::order]
    look(weed_map, range(1, 4), lambda _: tuple(pair))
    drift(weed_map, range(4, 50), 0.19, 0.09)
    assert len(weed_map.plants()) == 2, "the nearer of both has become one with the first"
    drift(weed_map, range(50, 100), 0.24, 0.165)
    drift(weed_map, range(100, 150), 0.155, 0.155)
    assert len(weed_map.plants()) == 2
