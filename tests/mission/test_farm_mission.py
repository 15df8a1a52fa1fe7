"""The main job, whole: every row driven, every plant standing, the weeds found.

By day over six metres of a row with a cheap receiver, so that the camera has to hold the robot on
it; every night all rows with many seeds.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import pytest

from tests import nightly
from tests.mission.conftest import FEW_HZ, FarmDrive, FarmRun

pytestmark = [pytest.mark.slow, pytest.mark.figures]
DRIVES = (
    FarmDrive(3, FEW_HZ, rows=1, length_m=6.0, sensors="m8n"),
    FarmDrive(1, FEW_HZ),
    *(FarmDrive(seed) for seed in (1, 2, 3, 4, 5)),
)
each_drive = nightly.one_by_one("drive", DRIVES, in_suite=1)


@each_drive
def test_all_rows_are_driven_and_no_plant_is_crushed(farm_run: FarmRun, drive: FarmDrive) -> None:
    _, report = farm_run(drive)
    assert report.ok, report.reason
    assert report.mission.rows_done == report.mission.rows_total == drive.rows
    assert report.tracking.plants_total == 36
    assert report.tracking.plants_crushed == 0


@each_drive
def test_the_robot_stays_within_ten_centimetres_of_the_row(
    farm_run: FarmRun, drive: FarmDrive
) -> None:
    _, report = farm_run(drive)
    assert report.tracking.xte_p95_m is not None
    assert report.tracking.xte_p95_m <= 0.10


@each_drive
def test_four_of_five_weeds_are_found_and_four_of_five_finds_are_weeds(
    farm_run: FarmRun, drive: FarmDrive
) -> None:
    weeds = farm_run(drive)[1].weeds
    assert weeds.truth is not None
    assert weeds.truth > 5 * drive.rows
    assert weeds.precision is not None
    assert weeds.recall is not None
    assert weeds.precision >= 0.8
    assert weeds.recall >= 0.8


@nightly.all_or_first("drives", DRIVES, in_suite=1, unit="drives")
def test_the_filter_knows_its_own_error(farm_run: FarmRun, drives: Sequence[FarmDrive]) -> None:
    nees = [farm_run(drive)[1].estimate.nees_mean for drive in drives]
    assert all(value is not None for value in nees)
    mean = sum(value for value in nees if value is not None) / len(nees)
    assert 0.3 < mean < 6.0  # three states: 3 is ideal, far below is timid, far above is blind


def test_all_files_of_a_run_are_there_and_hold_the_same_result(farm_run: FarmRun) -> None:
    out, report = farm_run(DRIVES[0])
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
