from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from agribot.autonomy.implements.crop_guard import find_keep_off_m
from agribot.autonomy.implements.treatment import Treatment
from agribot.core.config import TreatmentConfig
from agribot.sim.flora.crown import HEART_M
from tests.autonomy.implements.spray_ground import (
    BOOM,
    FINE,
    Field,
    drive_over,
    figure,
    make_map,
)
from tests.autonomy.weeds.weed_field import make_estimate


def test_a_weed_inside_the_guard_ring_of_a_crop_is_left_alone() -> None:
    weed_map = make_map([(1.06, 0.03)], [(1.0, 0.03)])
    treatment = Treatment(TreatmentConfig(), BOOM)
    drive_over(treatment, weed_map, Field())
    assert figure(treatment, "sprayed") == 0.0
    assert weed_map.weeds()[0].treated_s is None


def test_crops_stay_dry_and_separate_weeds_beside_them_get_wet() -> None:
    rng = np.random.default_rng(11)
    crops = [(1.0 + 0.3 * i, 0.0) for i in range(10)]
    weeds: list[tuple[float, float]] = []
    while len(weeds) < 40:
        place = (float(rng.uniform(0.8, 4.0)), float(rng.uniform(-0.35, 0.35)))
        if all(math.dist(place, other) > 0.10 for other in (*crops, *weeds)):
            weeds.append(place)
    plants = {f"crop{i}": place for i, place in enumerate(crops)}
    plants |= {f"weed{i}": place for i, place in enumerate(weeds)}
    weed_map = make_map(weeds, crops)
    truth = Field(plants=plants)
    drive_over(Treatment(TreatmentConfig(), BOOM), weed_map, truth, way_m=5.0)
    assert not [name for name in truth.hit if name.startswith("crop")]
    assert min(truth.closest_m[name] for name in plants if name.startswith("crop")) > 0.015
    separate = {
        f"weed{i}"
        for i, place in enumerate(weeds)
        if min(math.dist(place, crop) for crop in crops) > 0.15
    }
    assert len(separate) >= 20
    assert separate <= set(truth.hit)


def put_beside(
    places: Sequence[tuple[float, float]], off_m: float, ways_rad: Sequence[float]
) -> list[tuple[float, float]]:
    return [
        (x + off_m * math.cos(way), y + off_m * math.sin(way))
        for (x, y), way in zip(places, ways_rad, strict=True)
    ]


def test_the_heart_of_a_crop_stays_dry_that_all_looks_and_the_way_to_the_tool_have_moved() -> None:
    """By twice 20 and 12 mm: what all looks are off by no number of them shows."""
    mapped = [(1.0 + 0.4 * i, 0.0) for i in range(24)]
    # Each stands towards a weed that is apart from it, before or behind it, left or right.
    ways_rad = [math.pi / 2.0 * i + math.radians(30.0 + 5.0 * (i // 4)) for i in range(24)]
    off_m = 2.0 * math.hypot(0.020, 0.012)
    weeds = put_beside(mapped, 0.145, ways_rad)
    plants = {f"crop{i}": at for i, at in enumerate(put_beside(mapped, off_m, ways_rad))}
    truth = Field(sprayer=FINE, latency_s=FINE.latency_s, plants=plants)
    treatment = Treatment(TreatmentConfig(margin_m=0.08), FINE)
    drive_over(treatment, make_map(weeds, mapped), truth, way_m=12.0)
    assert figure(treatment, "plants treated as weeds") == len(weeds)
    assert min(truth.closest_m.values()) > HEART_M


def test_without_the_crop_in_the_map_the_same_spray_would_wet_it() -> None:
    """Guards the test above: it is the guard that keeps the crop dry."""
    crop, weed = (1.0, 0.0), (1.03, 0.0)
    truth = Field(plants={"crop": crop})
    drive_over(Treatment(TreatmentConfig(), BOOM), make_map([weed]), truth)
    assert "crop" in truth.hit


@pytest.mark.parametrize(
    ("look_std_m", "way_std_m", "keep_off_m"),
    [(0.02, 0.012, 0.07), (0.005, 0.003, 0.0465), (0.0, 0.0, 0.0438), (0.04, 0.012, 0.1035)],
    ids=["as shipped", "a camera over the tool", "nothing shared", "a poor mount"],
)
def test_the_spray_keeps_off_a_stem_by_twice_what_its_place_is_off_by(
    look_std_m: float, way_std_m: float, keep_off_m: float
) -> None:
    """A stem of 2 cm, and looks that differ by 1 cm beside what all of them share."""
    config = TreatmentConfig(look_std_m=look_std_m, way_std_m=way_std_m)
    (crop,) = make_map([], [(1.0, 0.0)]).tracks
    estimate = make_estimate(0.0, 0.0, 0.0, 0.0)
    assert find_keep_off_m(crop, estimate, config) == pytest.approx(keep_off_m, abs=1e-4)


@pytest.mark.parametrize("std_m", [0.003, 0.01])
def test_a_robot_that_measures_less_error_treats_weeds_nearer_to_the_crop(std_m: float) -> None:
    """6 cm from a stem, where the shipped errors leave all weeds; no heart of a crop gets wet."""
    crops = [(1.0 + 0.4 * i, 0.0) for i in range(6)]
    ways_rad = [math.pi / 2.0 * i for i in range(6)]
    weeds = put_beside(crops, 0.062, ways_rad)

    def count_treated(config: TreatmentConfig) -> float:
        plants = {f"crop{i}": place for i, place in enumerate(crops)}
        truth = Field(sprayer=FINE, latency_s=FINE.latency_s, plants=plants)
        treatment = Treatment(config, FINE)
        drive_over(treatment, make_map(weeds, crops), truth, way_m=4.0)
        assert min(truth.closest_m.values(), default=1.0) > HEART_M
        return figure(treatment, "plants treated as weeds")

    near = TreatmentConfig(crop_guard_m=0.0, look_std_m=std_m, way_std_m=0.0)
    assert count_treated(TreatmentConfig()) == 0
    assert count_treated(near) >= 3
