"""Ground under crop leaves stays dry, whatever the map knows of the plants there."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.weeds.crop_ground import CropGround
from agribot.autonomy.weeds.map import WeedMap
from agribot.autonomy.weeds.poses import PoseAt
from agribot.core.config import TreatmentConfig, WeedConfig
from agribot.core.implement.sprayer import SprayerSpec
from agribot.core.messages import CropCover, PlantClass
from tests.autonomy.implements.spray_ground import Field, drive_over
from tests.autonomy.weeds.weed_field import make_estimate, make_plant, make_scene

CELL_M, ROWS, COLUMNS = 0.025, 48, 64
CORNER_M = (0.3, -0.8)
BOOM = SprayerSpec(
    x_body_m=-0.35, section_count=9, section_spacing_m=0.1, section_width_m=0.1, latency_s=0.05
)
IsCrop = Callable[[float, float], bool]
POSE = PoseAt(t_s=0.0, x_map_m=0.0, y_map_m=0.0, yaw_map_rad=0.0, cov=(0.0,) * 9)


def closed_row(x_m: float, y_m: float) -> bool:
    """Leaves that touch, all along the row."""
    return abs(y_m) <= 0.12


def cover(pose: PoseAt, is_crop: IsCrop) -> CropCover:
    """What a camera over the pose sees of crop that stands in the map."""
    cos, sin = math.cos(pose.yaw_map_rad), math.sin(pose.yaw_map_rad)
    crop = np.zeros((ROWS, COLUMNS), dtype=bool)
    for row, column in np.ndindex(ROWS, COLUMNS):
        x_m, y_m = CORNER_M[0] + (row + 0.5) * CELL_M, CORNER_M[1] + (column + 0.5) * CELL_M
        crop[row, column] = is_crop(
            pose.x_map_m + cos * x_m - sin * y_m, pose.y_map_m + sin * x_m + cos * y_m
        )
    return CropCover(
        x_body_m=CORNER_M[0], y_body_m=CORNER_M[1], cell_m=CELL_M, rows=ROWS, columns=COLUMNS,
        crop=np.packbits(crop).tobytes(), seen=np.packbits(np.ones_like(crop)).tobytes(),
    )  # fmt: skip


def seen_on_the_way(
    weeds: list[tuple[float, float]],
    is_crop: IsCrop,
    crops: list[tuple[float, float]] | None = None,
) -> WeedMap:
    """The map after a drive of 2.5 m along x that saw weeds, leaves, and these crop plants."""
    weed_map = WeedMap(WeedConfig())
    for step in range(25):
        t_s, x_m = 0.25 * step, 0.1 * step
        weed_map.track_pose(make_estimate(t_s, x_m, 0.0, 0.0))
        plants = tuple(
            make_plant(x - x_m, y, PlantClass.WEED, std_m=0.01)
            for x, y in weeds
            if 0.3 < x - x_m < 1.5
        ) + tuple(
            msgspec.structs.replace(make_plant(x - x_m, y, PlantClass.CROP), area_m2=0.03)
            for x, y in crops or ()
            if 0.3 < x - x_m < 1.5
        )
        pose = msgspec.structs.replace(POSE, x_map_m=x_m)
        scene = make_scene(t_s, plants, view=())
        weed_map.add(msgspec.structs.replace(scene, crop_cover=cover(pose, is_crop)))
    return weed_map


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
        return area.covers(1.0, 0.0, 0.0, 0.05, 0.05)

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
    assert area.covers(5.3, -2.0, 0.3, 0.02, 0.02)
    assert not area.covers(5.0, -2.0, 0.3, 0.02, 0.02)
    lap_m = 256 * 0.025
    assert not area.covers(5.3 + lap_m, -2.0, 0.3, 0.02, 0.02)
    far = msgspec.structs.replace(north, x_map_m=north.x_map_m + lap_m)
    area.add(cover(far, lambda x_m, y_m: False), far)
    assert not area.covers(5.3, -2.0, 0.3, 0.02, 0.02)


def test_a_recording_that_tells_no_cover_sprays_as_its_map_says() -> None:
    weed_map = WeedMap(WeedConfig())
    for step in range(6):
        weed_map.track_pose(make_estimate(0.1 * step, 0.0, 0.0, 0.0))
        weed_map.add(make_scene(0.1 * step, (make_plant(1.0, 0.0),), view=()))
    truth = Field(sprayer=BOOM, latency_s=BOOM.latency_s, plants={"weed": (1.0, 0.0)})
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, truth)
    assert set(truth.hit) == {"weed"}
