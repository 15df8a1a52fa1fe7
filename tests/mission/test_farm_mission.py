"""The main job, whole: every row driven, every plant standing, the weeds found."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agribot.record.report import Report
from tests.mission.conftest import FARM_SEEDS

pytestmark = pytest.mark.slow
Runs = dict[int, tuple[Path, Report]]


@pytest.mark.parametrize("seed", FARM_SEEDS)
def test_all_rows_are_driven_and_no_plant_is_crushed(farm_runs: Runs, seed: int) -> None:
    _, report = farm_runs[seed]
    assert report.ok, report.reason
    assert report.mission.rows_done == report.mission.rows_total == 6
    assert report.tracking.plants_total == 36
    assert report.tracking.plants_crushed == 0


@pytest.mark.parametrize("seed", FARM_SEEDS)
def test_the_robot_stays_within_ten_centimetres_of_the_row(farm_runs: Runs, seed: int) -> None:
    _, report = farm_runs[seed]
    assert report.tracking.xte_p95_m is not None
    assert report.tracking.xte_p95_m <= 0.10


@pytest.mark.parametrize("seed", FARM_SEEDS)
def test_four_of_five_weeds_are_found_and_four_of_five_finds_are_weeds(
    farm_runs: Runs, seed: int
) -> None:
    weeds = farm_runs[seed][1].weeds
    assert weeds.truth is not None
    assert weeds.truth > 30
    assert weeds.precision is not None
    assert weeds.recall is not None
    assert weeds.precision >= 0.8
    assert weeds.recall >= 0.8


def test_the_filter_knows_its_own_error(farm_runs: Runs) -> None:
    nees = [report.estimate.nees_mean for _, report in farm_runs.values()]
    assert all(value is not None for value in nees)
    mean = sum(value for value in nees if value is not None) / len(nees)
    assert 0.3 < mean < 6.0  # three states: 3 is ideal, far below is timid, far above is blind


def test_all_files_of_a_run_are_there_and_hold_the_same_result(farm_runs: Runs) -> None:
    out, report = farm_runs[1]
    names = {path.name for path in out.iterdir()}
    assert names == {
        "run.mcap",
        "report.json",
        "report.html",
        "map.png",
        "weeds.geojson",
        "config.toml",
        "events.jsonl",
        "mission.json",
        "job.json",
    }
    stored = json.loads((out / "report.json").read_text())
    assert stored["mission"]["rows_done"] == report.mission.rows_done
    features = json.loads((out / "weeds.geojson").read_text())["features"]
    mapped = [feature for feature in features if feature["properties"]["class"] == "weed"]
    assert report.weeds.mapped is not None
    assert len(mapped) >= report.weeds.mapped
