"""Ground under crop leaves stays dry, whatever the map knows of the plants there."""

from __future__ import annotations

import math
from typing import cast

import msgspec
import pytest

from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.weeds.crop_ground import CropGround
from agribot.autonomy.weeds.map import WeedMap
from agribot.core.config import LeafRule, TreatmentConfig, WeedConfig
from agribot.core.implement.plants import GroundBox
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import PlantClass
from agribot.core.pose import Pose2
from tests.autonomy.implements.looks import POSE, closed_row, cover, seen_on_the_way
from tests.autonomy.implements.spray_ground import Field, drive_over, figure, make_map
from tests.autonomy.weeds.weed_field import make_estimate, make_plant, make_scene

FINE = SprayerSpec(
    x_body_m=-0.35, section_count=27, section_spacing_m=0.04, section_width_m=0.04, latency_s=0.05
)
BOOM = SprayerSpec(
    x_body_m=-0.35, section_count=9, section_spacing_m=0.1, section_width_m=0.1, latency_s=0.05
)


def test_weeds_at_the_edge_of_a_closed_row_cost_no_crop_and_those_beside_it_are_sprayed() -> None:
    stems = {f"crop{i}": (1.0 + 0.18 * i, 0.0) for i in range(9)}
    edge = {f"edge{i}": (1.1 + 0.3 * i, 0.10) for i in range(4)}
    beside = {f"weed{i}": (1.2 + 0.3 * i, 0.3) for i in range(4)}
    truth = Field(sprayer=BOOM, latency_s=BOOM.latency_s, plants=stems | edge | beside)
    weed_map = seen_on_the_way([*edge.values(), *beside.values()], closed_row)
    assert not weed_map.crops()
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, truth, way_m=3.5)
    assert set(truth.hit) == set(beside)


def test_without_the_leaves_the_same_spray_would_wet_the_crop() -> None:
    """Guards the test above: it is the no-spray area that keeps the row dry."""
    stems = {f"crop{i}": (1.0 + 0.18 * i, 0.0) for i in range(9)}
    truth = Field(sprayer=BOOM, latency_s=BOOM.latency_s, plants=stems)
    weeds = [(1.0 + 0.18 * i, 0.04) for i in range(9)]
    drive_over(
        Treatment(TreatmentConfig(), BOOM),
        seen_on_the_way(weeds, lambda x_m, y_m: False),
        truth,
        way_m=3.5,
    )
    assert truth.hit


def test_a_weed_at_the_leaf_tips_of_a_plant_by_itself_is_sprayed_up_to_the_stem() -> None:
    """Of a plant that the map knows, the stem is what must stay dry."""
    stem, weed = (1.5, 0.0), (1.5, 0.18)

    def leaves(x_m: float, y_m: float) -> bool:
        return math.dist((x_m, y_m), stem) < 0.17

    truth = Field(sprayer=BOOM, latency_s=BOOM.latency_s, plants={"crop": stem, "weed": weed})
    weed_map = seen_on_the_way([weed], leaves, [stem])
    assert len(weed_map.crops()) == 1
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, truth, way_m=3.0)
    assert set(truth.hit) == {"weed"}


def test_one_plant_of_a_closed_row_in_the_map_opens_no_nozzle_over_its_neighbours() -> None:
    stems = [(1.0 + 0.18 * i, 0.0) for i in range(9)]
    weeds = [(1.0 + 0.18 * i, 0.06) for i in range(9)]
    truth = Field(
        sprayer=BOOM, latency_s=BOOM.latency_s, plants={str(i): p for i, p in enumerate(stems)}
    )
    weed_map = seen_on_the_way(weeds, closed_row, stems[4:5])
    assert len(weed_map.crops()) == 1
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, truth, way_m=3.5)
    assert not truth.hit


def test_a_row_that_looks_like_weeds_stays_dry_where_no_stem_explains_its_leaves() -> None:
    """Carrots are called weeds, and some of them are found as weeds; the row keeps its leaves."""
    stems = {f"carrot{i}": (1.0 + 0.05 * i, 0.0) for i in range(30)}
    beside = {f"weed{i}": (1.2 + 0.3 * i, 0.35) for i in range(4)}
    truth = Field(sprayer=BOOM, latency_s=BOOM.latency_s, plants=stems | beside)
    taken_for_weeds = list(stems.values())[::7]
    weed_map = seen_on_the_way([*taken_for_weeds, *beside.values()], closed_row, unknown=True)
    assert len(weed_map.weeds()) > len(beside) and not weed_map.crops()
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, truth, way_m=3.5)
    assert set(truth.hit) == set(beside)


TOUCHING = [(1.0 + 0.25 * i, 0.0) for i in range(7)]
BETWEEN = [(1.125 + 0.25 * i, 0.02) for i in range(6)]


def hit_between_beets(leaves: LeafRule, *, points: bool) -> set[str]:
    """What gets wet of beets every 25 cm whose leaves touch, all on the map, with weeds between."""
    stems = {f"crop{i}": place for i, place in enumerate(TOUCHING)}
    weeds = {f"weed{i}": place for i, place in enumerate(BETWEEN)}
    truth = Field(sprayer=FINE, latency_s=FINE.latency_s, plants=stems | weeds)
    weed_map = seen_on_the_way(BETWEEN, closed_row, TOUCHING, points=points)
    assert len(weed_map.crops()) == len(TOUCHING)
    drive_over(Treatment(TreatmentConfig(leaves=leaves), FINE), weed_map, truth, way_m=3.5)
    assert all(truth.closest_m.get(name, math.inf) >= 0.05 for name in stems)
    return set(truth.hit)


def test_leaves_that_point_to_stems_of_the_map_are_sprayed_and_the_stems_are_not() -> None:
    assert hit_between_beets("mapped", points=True) == {f"weed{i}" for i in range(len(BETWEEN))}


@pytest.mark.parametrize(("leaves", "points"), [("mapped", False), ("alone", True)])
def test_leaves_that_no_stem_explains_stay_dry_and_so_do_all_where_only_plants_alone_count(
    leaves: LeafRule, points: bool
) -> None:
    assert not hit_between_beets(leaves, points=points)


def test_leaves_that_point_to_a_plant_that_is_not_on_the_map_stay_dry() -> None:
    """A crop that was missed has leaves, too: it is they that keep its stem dry."""
    known = TOUCHING[:3] + TOUCHING[4:]
    truth = Field(sprayer=FINE, latency_s=FINE.latency_s, plants={"missed": TOUCHING[3]})
    weeds = [(TOUCHING[3][0] + 0.01, 0.0)]
    weed_map = seen_on_the_way(weeds, closed_row, known, stems=TOUCHING)
    drive_over(Treatment(TreatmentConfig(), FINE), weed_map, truth, way_m=3.5)
    assert not truth.hit
    assert [weed.left for weed in weed_map.weeds()] == ["leaf of crop"]


def test_leaves_of_a_plant_alone_stay_dry_as_well_where_none_may_be_sprayed() -> None:
    stem, weed = (1.5, 0.0), (1.5, 0.18)
    truth = Field(sprayer=BOOM, latency_s=BOOM.latency_s, plants={"weed": weed})
    weed_map = seen_on_the_way([weed], lambda x_m, y_m: math.dist((x_m, y_m), stem) < 0.17, [stem])
    drive_over(Treatment(TreatmentConfig(leaves="none"), BOOM), weed_map, truth)
    assert not truth.hit


def test_weeds_under_leaves_of_a_closed_row_are_sprayed_where_any_leaf_may_get_wet() -> None:
    """By an agent that the crop endures; the stems of the map stay dry all the same."""
    stems = {f"crop{i}": (1.0 + 0.18 * i, 0.0) for i in range(9)}
    edge = {f"edge{i}": (1.1 + 0.36 * i, 0.12) for i in range(4)}
    for leaves, hit in (("any", set(edge)), ("none", set())):
        truth = Field(sprayer=FINE, latency_s=FINE.latency_s, plants=stems | edge)
        weed_map = seen_on_the_way([*edge.values()], closed_row, [*stems.values()])
        config = TreatmentConfig(leaves=cast(LeafRule, leaves))
        drive_over(Treatment(config, FINE), weed_map, truth, way_m=3.5)
        assert set(truth.hit) == hit


def test_a_crop_that_was_seen_but_once_is_spared() -> None:
    crop, weed = (1.5, 0.01), (1.5, 0.12)
    weed_map = make_map([weed])
    weed_map.add(make_scene(3.0, (make_plant(*crop, PlantClass.CROP, std_m=0.01),), view=()), POSE)
    assert len(weed_map.plants()) == 2 and not weed_map.crops()
    treatment = Treatment(TreatmentConfig(), BOOM)
    drive_over(treatment, weed_map, Field(sprayer=BOOM, latency_s=BOOM.latency_s))
    assert figure(treatment, "sprayed") == 0.0
    again = Treatment(TreatmentConfig(), BOOM)
    drive_over(again, make_map([weed]), Field(sprayer=BOOM, latency_s=BOOM.latency_s))
    assert figure(again, "sprayed") > 0.0


def test_no_drop_falls_on_leaves_also_in_a_curve() -> None:
    leaves = {f"{i}": (1.3 + 0.02 * i, 0.17) for i in range(20)}
    weeds = [(1.3 + 0.1 * i, 0.22) for i in range(5)]
    weed_map = seen_on_the_way(weeds, lambda x_m, y_m: y_m < 0.18)
    truth = Field(sprayer=BOOM, latency_s=BOOM.latency_s, plants=leaves)
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, truth, way_m=3.0, yaw_rate_radps=0.03)
    assert not truth.hit


@pytest.mark.parametrize(
    ("seen", "closed"),
    [
        ("-+-", "---"),
        ("-++-", "--++"),
        ("-++--", "--++-"),
        ("-+++++-+-+--", "--+++++++++-"),
    ],
    ids=["one look", "one bare look", "two bare looks", "bare looks between others"],
)
def test_two_looks_close_a_cell_and_two_in_a_row_that_show_no_crop_open_it_again(
    seen: str, closed: str
) -> None:
    area = CropGround()

    def is_covered() -> bool:
        return area.covers(GroundBox(Pose2(1.0, 0.0, 0.0), 0.05, 0.05))

    looks = {"-": cover(POSE, lambda x_m, y_m: False), "+": cover(POSE, closed_row)}
    told = ""
    for look in seen:
        area.add(looks[look], POSE)
        told += "+" if is_covered() else "-"
    assert told == closed


def test_the_area_turns_with_the_robot_and_forgets_what_lies_far_behind() -> None:
    area = CropGround()
    north = msgspec.structs.replace(POSE, x_map_m=5.0, y_map_m=-3.0, yaw_map_rad=math.pi / 2)

    def patch(x_m: float, y_m: float) -> bool:
        return math.hypot(x_m - 5.3, y_m + 2.0) < 0.1

    for _ in range(2):
        area.add(cover(north, patch), north)
    assert area.covers(GroundBox(Pose2(5.3, -2.0, 0.3), 0.02, 0.02))
    assert not area.covers(GroundBox(Pose2(5.0, -2.0, 0.3), 0.02, 0.02))
    lap_m = 256 * 0.025
    assert not area.covers(GroundBox(Pose2(5.3 + lap_m, -2.0, 0.3), 0.02, 0.02))
    far = msgspec.structs.replace(north, x_map_m=north.x_map_m + lap_m)
    area.add(cover(far, lambda x_m, y_m: False), far)
    assert not area.covers(GroundBox(Pose2(5.3, -2.0, 0.3), 0.02, 0.02))


def test_a_recording_that_tells_no_cover_sprays_as_its_map_says() -> None:
    weed_map = WeedMap(WeedConfig())
    for step in range(6):
        weed_map.track_pose(make_estimate(0.1 * step, 0.0, 0.0, 0.0, v_mps=0.0))
        weed_map.add(make_scene(0.1 * step, (make_plant(1.0, 0.0),), view=()))
    truth = Field(sprayer=BOOM, latency_s=BOOM.latency_s, plants={"weed": (1.0, 0.0)})
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, truth)
    assert set(truth.hit) == {"weed"}
