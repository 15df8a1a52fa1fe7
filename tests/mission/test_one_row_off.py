"""Put down one row aside of its mark, a robot follows rows that are not those it believes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from agribot.app.mission_file import read_mission
from agribot.app.simulated_run import simulate
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core import config
from agribot.core.facts import RowsUnproven
from agribot.core.messages import MissionStatus
from agribot.core.world import WorldSpec
from agribot.description.worlds_sdf import load_run_world
from agribot.record.events import read_events
from agribot.record.report import Report
from tests import nightly
from tests.finding import find, list_codes
from tests.mission.paper_camera import CameraOnPaper

SETTINGS = ["seed=1", "perception.enabled=false", "record.enabled=false",
            "field.row_length_m=5", 'world="empty"', "field.start_map_m=[-1,0]",
            "field.start_yaw_deg=0", "mission.stall_timeout_s=20"]  # fmt: skip
BRISK = ["mission.speed_mps=0.8", "mission.turn_speed_mps=0.5"]  # twice as fast as usual
PITCH_M = 1.0


def drive(
    folder: Path, aside_m: float, monkeypatch: pytest.MonkeyPatch, *, has_cover: bool = False,
    speeds: Sequence[str] = BRISK, rows: int = 3,
) -> tuple[Report, MissionStatus]:  # fmt: skip
    """`aside_m` is how far left of its mark the robot is put down, across the rows."""

    def shifted(settings: config.RunConfig) -> WorldSpec:
        place = {"spawn_xy_map_m": (-1.0, aside_m), "spawn_yaw_map_rad": 0.0}
        return msgspec.structs.replace(load_run_world(settings), **place)

    monkeypatch.setattr("agribot.app.run_world.load_run_world", shifted)
    with simulate(
        config.load("rows-10x12", [*SETTINGS, *speeds, f"field.row_count={rows}"]), folder
    ) as session:
        session.stack.perception = CameraOnPaper(
            session, lay_rows(session.config.field), has_cover=has_cover
        )
        *_, last = session.ticks()
        return session.finish(), last.status


@nightly.by_day(
    "test_where_it_sees_what_grows_beside_its_row_it_asks_at_the_entry_which_row_this_is",
    "tests/autonomy/plan/test_row_recovery.py::"
    "test_a_row_of_which_nothing_was_ever_seen_may_be_none_and_is_not_left_out",
    "tests/autonomy/plan/test_row_evidence.py::"
    "test_a_row_given_up_on_bare_ground_undoes_those_told_by_counting_once_most_of_it_is_driven",
)
def test_beyond_the_crop_it_stands_and_the_report_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, status = drive(tmp_path / "run", -PITCH_M, monkeypatch, speeds=())
    assert not report.ok and report.mission.success is False
    assert (status.rows_done, sorted(status.rows_unproven)) == ((), [0, 1, 2])
    assert report.mission.rows_done == 0  # in truth
    assert "may_be_off_row" in list_codes(read_events(tmp_path / "run" / "events.jsonl"))
    assert report.tracking.plants_crushed == 0


@nightly.by_day(
    "tests/autonomy/plan/test_row_evidence.py::"
    "test_a_bare_row_undoes_all_that_were_told_by_counting_from_a_mark",
    "test_where_it_sees_what_grows_beside_its_row_it_asks_at_the_entry_which_row_this_is",
)
def test_one_row_off_towards_the_crop_no_row_counts_once_the_last_lies_on_bare_ground(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, status = drive(tmp_path / "run", PITCH_M, monkeypatch)
    assert not report.ok and report.mission.success is False
    assert status.rows_done == ()
    assert sorted(status.rows_unproven) == [0, 1, 2]
    assert report.mission.rows_unproven == (1, 2, 3)
    assert report.mission.rows_done == 0  # in truth
    unproven = find(status.fact, RowsUnproven).rows
    assert {one.variant for one in unproven} >= {"unseen", "counted"}
    saved = read_mission(tmp_path / "run")
    assert not any(row.done for row in saved.rows)
    assert saved.covered == ()


@nightly.by_day("test_on_its_mark_it_asks_nothing")
def test_on_its_mark_the_same_robot_does_all_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, status = drive(tmp_path / "run", 0.0, monkeypatch)
    assert status.rows_unproven == ()
    assert report.mission.success and report.mission.rows_done == 3, report.reason
    assert report.mission.rows_unproven == ()


@pytest.mark.parametrize(
    "aside_m",
    [
        -PITCH_M,
        pytest.param(
            PITCH_M,
            marks=nightly.by_day(
                "test_where_it_sees_what_grows_beside_its_row_it_asks_at_the_entry_which_row_this_is"
            ),
        ),
    ],
)
def test_where_it_sees_what_grows_beside_its_row_it_asks_at_the_entry_which_row_this_is(
    aside_m: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, status = drive(tmp_path / "run", aside_m, monkeypatch, has_cover=True)
    assert not report.ok
    assert status.rows_done == status.rows_unproven == ()
    assert "which_row" in list_codes(read_events(tmp_path / "run" / "events.jsonl"))
    assert (report.mission.distance_m or 0.0) < 5.0  # 4 m of them across the headland
    assert report.tracking.plants_crushed == 0


def test_on_its_mark_it_asks_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report, _ = drive(tmp_path / "run", 0.0, monkeypatch, has_cover=True, rows=2)
    assert report.ok, report.reason
    assert report.mission.rows_done == 2
