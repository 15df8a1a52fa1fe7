"""Beside the rows, nozzles open where the looks suspect weeds that are not on the map."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.implements.treatment import Treatment
from agribot.autonomy.implements.zones import ZoneMap
from agribot.core.config import TreatmentConfig
from tests.autonomy.implements.looks import seen_on_the_way
from tests.autonomy.implements.spray_ground import Field, drive_over
from tests.autonomy.implements.test_beside_rows import FINE, ROW, wide_leaves

Places = list[tuple[float, float]]
PLACE_M = (1.5, 0.25)


def spray(
    suspected: dict[tuple[float, float], float],
    mapped: Places = ROW,
    least_weed_score: float = 0.1,
    zones: ZoneMap | None = None,
) -> Field:
    """What gets wet of suspected weeds, all under leaves, and of a row that is on the map."""
    crops = {f"crop{i}": place for i, place in enumerate(ROW)}
    weeds = {f"weed{i}": place for i, place in enumerate(suspected)}
    field = Field(sprayer=FINE, latency_s=FINE.latency_s, plants=crops | weeds)
    weed_map = seen_on_the_way([], wide_leaves, mapped, suspected=suspected)
    config = TreatmentConfig(leaves="rows", least_weed_score=least_weed_score)
    drive_over(Treatment(config, FINE, zones), weed_map, field, way_m=3.5)
    return field


def test_what_the_looks_suspect_beside_a_row_is_sprayed_and_little_around_it() -> None:
    field = spray({PLACE_M: 0.15})
    assert set(field.hit) == {"weed0"}
    assert field.wet_m2 < 0.02


@pytest.mark.parametrize("score", [0.0, 0.08])
def test_what_scores_less_than_asked_for_stays_dry(score: float) -> None:
    assert spray({PLACE_M: score}).wet_m2 == 0.0


def test_by_default_nothing_is_sprayed_that_is_not_on_the_map() -> None:
    assert spray({PLACE_M: 1.0}, least_weed_score=TreatmentConfig().least_weed_score).wet_m2 == 0.0


def test_what_is_suspected_in_a_row_or_where_no_row_is_known_stays_dry() -> None:
    assert spray({(1.63, 0.02): 0.9}).wet_m2 == 0.0
    assert spray({PLACE_M: 0.9}, mapped=[]).wet_m2 == 0.0


def test_no_nozzle_opens_beside_a_surer_place_that_has_to_stay_dry() -> None:
    """It is the skirt of a weed in the row."""
    aside, in_row = (1.63, 0.13), (1.63, 0.05)
    assert spray({aside: 0.2}).hit
    assert spray({aside: 0.2, in_row: 0.5}).wet_m2 == 0.0
    assert "weed0" in spray({aside: 0.5, in_row: 0.2}).hit


def test_ground_without_a_zone_of_the_prescription_stays_dry() -> None:
    spared = ZoneMap(-1.0, -2.0, 0.1, np.zeros((40, 80), dtype=np.float32))
    assert spray({PLACE_M: 0.9}, zones=spared).wet_m2 == 0.0
