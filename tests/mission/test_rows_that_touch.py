"""Rows whose leaves touch: every crop plant is on the map, and none is sprayed."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.record.report import Report
from tests import nightly
from tests.mission.conftest import ALL_HZ, FEW_HZ, run_session, see_at

FIRST_ROW_S = 60.0
pytestmark = [
    pytest.mark.slow,
    nightly.by_day(
        "tests/lab/train/test_plants_model.py::test_beets_whose_leaves_touch_are_single_plants",
        "tests/autonomy/perceive/test_stem_plants.py::"
        "test_crops_whose_leaves_touch_are_each_a_plant",
        "tests/autonomy/implements/test_spray_and_leaves.py::"
        "test_weeds_at_the_edge_of_a_closed_row_cost_no_crop_and_those_beside_it_are_sprayed",
    ),
]


@pytest.fixture(scope="module", params=[FEW_HZ, ALL_HZ])
def report(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Report:
    out = tmp_path_factory.mktemp("beet") / "run"
    settings = ["seed=1", 'sim.sensors="rtk"', f"duration_s={FIRST_ROW_S}", see_at(request.param)]
    return run_session("beet", [*settings, "record.enabled=false"], str(Path(out)))


def test_beets_of_a_row_that_closes_are_mapped_one_by_one(report: Report) -> None:
    found = report.weeds
    assert report.mission.rows_done == 1
    assert found.crops_truth is not None and found.crops_truth > 35
    assert found.crop_recall is not None and found.crop_recall > 0.9
    assert found.crops_mapped is not None and found.crops_mapped <= 1.3 * found.crops_truth
    assert found.stem_error_p95_m is not None and found.stem_error_p95_m < 0.05


def test_weeds_among_them_are_treated_and_no_crop_is(report: Report) -> None:
    found = report.weeds
    assert found.treated_true is not None and found.treated_true >= 4
    assert found.crops_hit == 0
    assert report.tracking.plants_crushed == 0
