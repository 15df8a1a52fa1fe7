"""The whole mission with a receiver that is off by metres: the camera has to see the rows."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.record.events import read_events
from tests import nightly
from tests.finding import list_codes
from tests.mission.conftest import ALL_HZ, FEW_HZ, run_session, see_at

BLIND = ["perception.enabled=false", "record.enabled=false"]


@pytest.mark.slow
@nightly.by_day(
    "tests/mission/test_farm_mission.py::test_all_rows_are_driven_and_no_plant_is_crushed",
    "tests/mission/test_rows_of_a_plan.py::"
    "test_a_cheap_receiver_holds_the_rows_of_a_plan_by_the_camera",
)
@pytest.mark.parametrize("drive", [(2, FEW_HZ), (6, ALL_HZ)])
def test_a_cheap_receiver_and_the_camera_drive_all_rows_and_crush_nothing(
    tmp_path: Path, drive: tuple[int, float]
) -> None:
    rows, pictures_hz = drive
    settings = ["seed=1", 'sim.sensors="m8n"', f"field.row_count={rows}", see_at(pictures_hz)]
    report = run_session("farm", settings, str(tmp_path))
    assert report.ok, report.reason
    assert report.mission.rows_done == report.mission.rows_total == rows
    assert report.tracking.plants_crushed == 0
    assert report.tracking.xte_max_m is not None
    assert report.tracking.xte_max_m < 0.25
    assert report.estimate.nees_mean is not None
    assert report.estimate.nees_mean < 6.0
    assert main(["replay", str(tmp_path / "run.mcap")]) == 0


def test_without_the_camera_a_cheap_receiver_stops_before_it_crushes_the_crop(
    tmp_path: Path,
) -> None:
    settings = ["seed=1", 'sim.sensors="m8n"', *BLIND, "mission.stall_timeout_s=5"]
    report = run_session("farm", settings, str(tmp_path))
    assert not report.ok
    assert report.mission.rows_done is not None and report.mission.rows_done < 6
    assert report.weeds.precision is None  # no camera: not applicable, not zero
    assert "may_be_off_row" in list_codes(read_events(tmp_path / "events.jsonl"))
    assert "no operator resumed the mission for 5 s" in report.reason
    assert report.tracking.plants_crushed == 0


def test_a_robot_that_is_not_on_its_mark_never_moves_and_the_run_ends(tmp_path: Path) -> None:
    elsewhere = ["field.start_map_m=[-30.0, 0.0]", "mission.stall_timeout_s=5"]
    settings = ["seed=1", 'sim.sensors="rtk"', *BLIND, *elsewhere]
    report = run_session("farm", settings, str(tmp_path))
    assert not report.ok
    assert "start_aside" in list_codes(read_events(tmp_path / "events.jsonl"))
    assert report.mission.distance_m is not None
    assert report.mission.distance_m < 0.05
