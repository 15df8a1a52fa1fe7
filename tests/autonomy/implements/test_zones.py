"""A prescription as a rule of treatment: only in zones with a rate, and with that rate."""

from __future__ import annotations

import math

import numpy as np
import pytest

from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.implements.zones import ZoneMap
from agribot.core.config import TreatmentConfig
from tests.autonomy.implements.looks import seen_on_the_way
from tests.autonomy.implements.spray_ground import BOOM, Field, drive_over, figure, make_map
from tests.autonomy.implements.test_hoe import HOE, Ground, bare, hoe_along
from tests.autonomy.weeds.weed_field import make_estimate

CELL_M = 0.1


def zones(*strips: float) -> ZoneMap:
    """Strips of a metre each across the way from x = 0 on, with these rates."""
    rates = np.repeat(np.array(strips, np.float32), round(1.0 / CELL_M))
    return ZoneMap(0.0, -2.0, CELL_M, np.tile(rates, (40, 1)))


def test_weeds_of_a_zone_without_a_rate_stay_dry() -> None:
    weeds = [(0.5 + i, 0.03) for i in range(4)]
    weed_map, truth = make_map(weeds), Field(plants={f"{x:g}": (x, y) for x, y in weeds})
    treatment = Treatment(TreatmentConfig(), BOOM, zones(200.0, 0.0, math.nan, 150.0))
    drive_over(treatment, weed_map, truth, way_m=5.0)
    assert set(truth.hit) == {"0.5", "3.5"}
    treated = [weed.x_map_m for weed in weed_map.weeds() if weed.treated_s is not None]
    assert sorted(treated) == pytest.approx([0.5, 3.5], abs=0.02)  # nor does it believe otherwise
    assert figure(treatment, "plants treated as weeds") == 2


def test_no_spray_falls_beyond_the_border_of_a_zone() -> None:
    weeds = [(0.95, 0.03), (1.05, 0.03)]
    truth = Field(plants={"in": weeds[0], "out": weeds[1], "well in": (0.8, 0.03)})
    drive_over(Treatment(TreatmentConfig(), BOOM, zones(200.0, 0.0)), make_map(weeds), truth)
    assert "out" not in truth.hit


def test_the_command_has_the_rate_of_the_zone_below_the_boom() -> None:
    weed_map = make_map([(0.5, 0.03), (1.5, 0.03)])
    treatment = Treatment(TreatmentConfig(), BOOM, zones(120.0, 80.0))
    rates = set()
    for tick in range(400):
        estimate = make_estimate(10.0 + 0.02 * tick, 0.008 * tick, 0.0, 0.0, v_mps=0.4)
        command = treatment.step(estimate, weed_map, True)
        if any(command.sections_on):
            rates.add(command.setpoints["rate_lpha"])
        else:
            assert not command.setpoints
    assert rates == {120.0, 80.0}


def test_blades_stay_up_in_a_zone_without_a_rate() -> None:
    weeds_m = [(0.6 + i, 0.2) for i in range(3)]
    weed_map = seen_on_the_way(weeds_m, bare, [])
    ground = Ground([], weeds_m)
    hoe_along(Treatment(TreatmentConfig(), HOE, zones(1.0, 0.0, 1.0, 1.0)), weed_map, ground)
    assert ground.weeds_uprooted == {0, 2}


def test_blades_stay_up_beside_a_row_in_a_zone_without_a_rate() -> None:
    stems_m = [(0.4 + 0.25 * i, 0.0) for i in range(14)]
    weeds_m = [(0.6 + i, 0.3) for i in range(3)]
    weed_map = seen_on_the_way(weeds_m, bare, stems_m)
    ground = Ground(stems_m, weeds_m)
    config = TreatmentConfig(leaves="rows")
    hoe_along(Treatment(config, HOE, zones(1.0, 0.0, 1.0, 1.0)), weed_map, ground)
    assert not ground.crops_cut
    assert ground.weeds_uprooted == {0, 2}


def test_outside_of_all_zones_nothing_is_treated() -> None:
    weed_map, truth = make_map([(1.0, 0.03)]), Field(plants={"weed": (1.0, 0.03)})
    elsewhere = zones(200.0)._replace(x_min_m=100.0)
    drive_over(Treatment(TreatmentConfig(), BOOM, elsewhere), weed_map, truth)
    assert not truth.hit and truth.wet_m2 == 0.0
