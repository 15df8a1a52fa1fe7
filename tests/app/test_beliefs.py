"""What the robot believes stands beside what is known."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from agribot.app.beliefs import BeliefSums
from agribot.app.simulated_run import simulate
from agribot.app.whole_job import read_job
from agribot.core.config import load
from agribot.record.report import BeliefReport, Report
from tests import nightly
from tests.record import record_samples as samples

BLIND = ["perception.enabled=false", "record.enabled=false", "sim.sensors='ideal'"]


def _drive(folder: Path, *settings: str) -> dict[str, BeliefReport]:
    with simulate(load("farm", [*BLIND, *settings]), folder) as run:
        for _ in run.ticks():
            pass
        report: Report = run.finish()
    return {one.what: one for one in report.beliefs}


def test_where_the_sensors_are_ideal_the_robot_believes_what_is_true(tmp_path: Path) -> None:
    beliefs = _drive(tmp_path, "duration_s=45", "field.row_length_m=4")
    rows, way = beliefs["rows done"], beliefs["way driven"]
    assert (rows.believed, rows.known) == (1, 1)
    assert way.known is not None and way.believed == pytest.approx(way.known, rel=0.02)
    across = beliefs["cross-track error, RMS"]
    assert across.known is not None and across.believed == pytest.approx(across.known, abs=0.005)
    worked = beliefs["share of the rows worked"]
    assert worked.believed == pytest.approx(worked.known, abs=0.02)


@nightly.by_day(
    "test_where_the_sensors_are_ideal_the_robot_believes_what_is_true",
    "tests/mission/test_drawn_worlds.py::"
    "test_the_cross_track_error_is_that_against_the_plants_and_not_against_the_map",
)
def test_a_map_that_is_off_shows_in_what_is_known_and_not_in_what_is_believed(
    tmp_path: Path,
) -> None:
    preset = tmp_path / "off.toml"
    preset.write_text('about = "the map is off"\nmap_offset_std_m = 0.1\n')
    beliefs = _drive(tmp_path / "run", "duration_s=35", f"sim.preset={preset}", "seed=2")
    across = beliefs["cross-track error, RMS"]
    assert across.believed is not None and across.known is not None
    assert across.believed < 0.02
    assert across.known > 0.03


def test_nobody_who_drives_without_a_truth_is_told_what_is_known() -> None:
    sums = BeliefSums()
    for record in samples.ticks(50):
        sums.add(record, 0.02)
    assert sums.distance_m == pytest.approx(50 * 0.02 * samples.SPEED_MPS, rel=0.2)
    before = msgspec.structs.replace(sums)
    lost = msgspec.structs.replace(samples.ticks(1)[0].estimate, ok=False)
    sums.add(msgspec.structs.replace(samples.ticks(1)[0], estimate=lost), 0.02)
    assert sums == before


def test_what_was_believed_outlives_the_run_in_the_account_of_the_job(tmp_path: Path) -> None:
    with simulate(load("farm", [*BLIND, "duration_s=12"]), tmp_path) as run:
        for _ in run.ticks():
            pass
        run.finish()
        saved = run.stack.mission.snapshot()
    assert saved is not None
    job = read_job(tmp_path, saved)
    assert job.believed.distance_m == pytest.approx(run.job.believed.distance_m, rel=0.05)
    assert job.believed.distance_m > 0.5
