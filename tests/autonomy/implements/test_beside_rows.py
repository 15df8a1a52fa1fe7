"""Leaves beside a row of the map may be sprayed: no heart of a crop stands there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.implements.beside_rows import RowCrop, RowsAround
from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.implements.zones import ZoneMap
from agribot.core.config import LeafRule, TreatmentConfig
from agribot.core.implement.sprayer import SprayerSpec
from tests.autonomy.implements.looks import seen_on_the_way
from tests.autonomy.implements.spray_ground import Field, drive_over

FINE = SprayerSpec(
    x_body_m=-0.35, section_count=27, section_spacing_m=0.04, section_width_m=0.04, latency_s=0.05
)
ROW = [(0.75 + 0.25 * i, 0.0) for i in range(9)]
BESIDE = [(1.3 + 0.2 * i, 0.25) for i in range(4)]
Places = list[tuple[float, float]]


def wide_leaves(x_m: float, y_m: float) -> bool:
    """Leaves that touch, and reach far beside the row."""
    return abs(y_m) <= 0.54


def spray(
    mapped: Places,
    truth: Places,
    leaves: LeafRule = "rows",
    zones: ZoneMap | None = None,
    *,
    beside: Places = BESIDE,
    beside_row_m: float = 0.4,
) -> set[str]:
    """What gets wet of crops and of weeds beside their row, all under leaves that show no stem."""
    crops = {f"crop{i}": place for i, place in enumerate(truth)}
    weeds = {f"weed{i}": place for i, place in enumerate(beside)}
    field = Field(sprayer=FINE, latency_s=FINE.latency_s, plants=crops | weeds)
    weed_map = seen_on_the_way(beside, wide_leaves, mapped)
    config = TreatmentConfig(leaves=leaves, beside_row_m=beside_row_m)
    treatment = Treatment(config, FINE, zones)
    drive_over(treatment, weed_map, field, way_m=3.5)
    return set(field.hit)


def test_weeds_under_leaves_beside_a_row_of_the_map_are_sprayed() -> None:
    assert spray(ROW, ROW) == {f"weed{i}" for i in range(len(BESIDE))}


@pytest.mark.parametrize("leaves", ["mapped", "alone", "none"])
def test_no_other_rule_sprays_leaves_that_tell_no_stem(leaves: LeafRule) -> None:
    assert not spray(ROW, ROW, leaves)


def test_every_other_plant_of_a_row_may_be_missing_from_the_map() -> None:
    """A crop that was not found stands in line with those that were found: it stays dry."""
    assert spray(ROW[::2], ROW) == {f"weed{i}" for i in range(len(BESIDE))}


def test_two_plants_make_no_row() -> None:
    assert not spray(ROW[2:4], ROW)


def test_a_row_seen_but_once_beside_the_first_keeps_its_leaves_dry() -> None:
    crops = [RowCrop(x, y, True) for x, y in ((-0.3, 0.0), (0.0, 0.0), (0.3, 0.0))]
    assert RowsAround(crops, 0.4).is_beside(0.25, 0.05, 0.03)
    seen_once = RowCrop(0.6, 0.3, False)
    assert not RowsAround([*crops, seen_once], 0.4).is_beside(0.25, 0.05, 0.03)


def test_plants_that_were_seen_but_once_make_no_row() -> None:
    crops = [RowCrop(0.3 * i, 0.0, i != 0) for i in (-1, 0, 1)]
    assert not RowsAround(crops, 0.4).is_beside(0.25, 0.05, 0.03)


@pytest.mark.parametrize("turn_deg", [-3.0, 0.0, 3.0])
@pytest.mark.parametrize("along_m", [-0.12, 0.0, 0.12])
def test_no_heart_of_a_row_lies_in_a_box_beside_it_though_the_robot_drives_askew(
    turn_deg: float, along_m: float
) -> None:
    """Hearts of a sown row, 2 cm wide and up to 2 cm beside its line, with every third unknown."""
    rng = np.random.default_rng(7)
    cos, sin = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    for _ in range(200):
        beside_m = rng.uniform(-0.5, 0.5)
        hearts = [
            (cos * s - sin * off, beside_m + sin * s + cos * off)
            for s, off in zip(
                0.25 * np.arange(-4, 5) + along_m, rng.normal(0, 0.01, 9), strict=True
            )
        ]
        known = [RowCrop(x, y, True) for i, (x, y) in enumerate(hearts) if i % 3 != 1]
        for left_m in np.arange(-0.52, 0.53, 0.04):
            if RowsAround(known, 0.4).is_beside(left_m, 0.05, 0.03):
                gaps_m = [
                    math.hypot(max(abs(x) - 0.05, 0.0), max(abs(y - left_m) - 0.03, 0.0))
                    for x, y in hearts
                ]
                assert min(gaps_m) > 0.02


def test_weeds_half_way_between_rows_are_sprayed_where_rows_are_known_to_be_a_metre_apart() -> None:
    """Their own leaves may look like crop; the boom is broad enough for all of that ground."""
    between = [(1.3 + 0.2 * i, 0.5) for i in range(4)]
    assert not spray(ROW, ROW, beside=between)
    wet = spray(ROW, ROW, beside=between, beside_row_m=0.6)
    assert wet == {f"weed{i}" for i in range(len(between))}


@pytest.mark.parametrize("turn_deg", [-3.0, -1.0, 0.0, 2.0, 3.0])
def test_the_crops_of_a_row_tell_how_it_runs_so_that_weeds_near_it_are_sprayed(
    turn_deg: float,
) -> None:
    """Without it a row could pass the tool 6 cm beside where a crop 1 m away stands."""
    turn = math.tan(math.radians(turn_deg))
    row = [RowCrop(x, turn * x, True) for x in np.arange(-0.95, 1.0, 0.25).tolist()]
    assert all(RowsAround(row, 0.4).is_beside(side * 0.15, 0.05, 0.03) for side in (-1, 1))
    assert not any(RowsAround(row[::3], 0.4).is_beside(side * 0.15, 0.05, 0.03) for side in (-1, 1))


def test_a_row_of_which_many_crops_are_mapped_tells_how_far_off_it_they_stand() -> None:
    """Sown up to 4 cm beside the line, every fourth unknown: all keep 2 cm of their heart dry."""
    rng = np.random.default_rng(5)
    reached = 0
    for _ in range(200):
        hearts = [(x, rng.uniform(-0.04, 0.04)) for x in np.arange(-0.95, 1.0, 0.25).tolist()]
        known = [RowCrop(x, y, True) for i, (x, y) in enumerate(hearts) if i % 4 != 2]
        rows = RowsAround(known, 0.4)
        beside = [y_m for y_m in np.arange(-0.2, 0.2, 0.01) if rows.is_beside(y_m, 0.05, 0.03)]
        reached += min(abs(y_m) for y_m in beside) < 0.15
        for left_m in beside:
            assert all(
                math.hypot(max(abs(x) - 0.05, 0.0), max(abs(y - left_m) - 0.03, 0.0)) > 0.02
                for x, y in hearts
            )
    assert reached > 150


@pytest.mark.parametrize("side", [-1, 1])
def test_weeds_that_are_called_crop_do_not_turn_the_row_beside_them(side: int) -> None:
    rng = np.random.default_rng(11)
    weeds = [RowCrop(side * 0.9, 0.12, True), RowCrop(side * 0.65, 0.12, True)]
    for _ in range(50):
        hearts = [(x, rng.normal(0.0, 0.005)) for x in np.arange(-0.95, 1.0, 0.25).tolist()]
        rows = RowsAround([*weeds, *(RowCrop(x, y, True) for x, y in hearts)], 0.4)
        assert rows.is_beside(-0.17, 0.05, 0.03)
        assert not rows.is_beside(-0.08, 0.05, 0.03)


def test_a_zone_that_is_spared_stays_dry_beside_the_row_as_well() -> None:
    rates = np.full((40, 80), 150.0, dtype=np.float32)
    rates[:, :] = 0.0
    assert not spray(ROW, ROW, zones=ZoneMap(-1.0, -2.0, 0.1, rates))
