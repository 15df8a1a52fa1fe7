"""Put down one row aside of its mark, a robot follows rows that are not those it believes."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import pytest

from agribot.app.mission_file import read_mission
from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.autonomy.perception_host import NoPerception
from agribot.autonomy.plan.rows import lay_rows
from agribot.core import config
from agribot.core.geo import wrap_rad
from agribot.core.messages import MissionStatus, RowLine, Scene, SensorBatch
from agribot.core.row_shape import project_on_row, row_length_m
from agribot.core.world import WorldSpec
from agribot.description.worlds_sdf import load_run_world
from agribot.record.report import Report

SETTINGS = ["seed=1", "perception.enabled=false", "record.enabled=false", "field.row_count=3",
            "field.row_length_m=5", 'world="empty"']  # fmt: skip
PITCH_M = 1.0
LOOK_S, FAR_M, MAX_OFFSET_M = 0.1, 1.2, 0.6


class CameraOnPaper(NoPerception):
    """Sees the line of the row that truly lies under the robot, where one does."""

    def __init__(self, session: SimulatedRun) -> None:
        self._session, self._rows = session, lay_rows(session.config.field)
        self._next_s, self._index = 0.0, 0

    def step(self, batch: SensorBatch) -> tuple[Scene, ...]:
        if batch.t_s < self._next_s:
            return ()
        self._next_s, self._index = batch.t_s + LOOK_S, self._index + 1
        return (Scene(t_s=batch.t_s, ready_s=batch.t_s, frame_index=self._index, plants=(),
                      view_body_m=(), row_line=self._line(batch.t_s)),)  # fmt: skip

    def _line(self, t_s: float) -> RowLine | None:
        truth = self._session.simulator.truth()
        for row in self._rows:
            along_m, left_m, yaw_rad = map(float, project_on_row(row, truth.x_map_m, truth.y_map_m))
            heading_rad = wrap_rad(truth.yaw_map_rad - yaw_rad)
            sign = 1.0 if math.cos(heading_rad) > 0.0 else -1.0
            ahead_m = along_m + sign * FAR_M
            if abs(left_m) > MAX_OFFSET_M or not 0.0 <= ahead_m <= row_length_m(row):
                continue
            turned_rad = heading_rad if sign > 0.0 else wrap_rad(heading_rad - math.pi)
            return RowLine(
                t_s=t_s, offset_m=sign * left_m, heading_rad=turned_rad, offset_std_m=0.015,
                heading_std_rad=0.012,
            )  # fmt: skip
        return None


def drive(
    folder: Path, aside_m: float, monkeypatch: pytest.MonkeyPatch
) -> tuple[Report, MissionStatus]:
    """`aside_m` is how far left of its mark the robot is put down, across the rows."""

    def shifted(settings: config.RunConfig) -> WorldSpec:
        place = {"spawn_xy_map_m": (-1.0, aside_m), "spawn_yaw_map_rad": 0.0}
        return msgspec.structs.replace(load_run_world(settings), **place)

    monkeypatch.setattr("agribot.app.run_world.load_run_world", shifted)
    with simulate(config.load("rows-10x12", SETTINGS), folder) as session:
        session.stack.perception = CameraOnPaper(session)
        *_, last = session.ticks()
        return session.finish(), last.status


def test_beyond_the_crop_it_stands_and_the_report_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, status = drive(tmp_path / "run", -PITCH_M, monkeypatch)
    assert not report.ok and report.mission.success is False
    assert (status.rows_done, status.rows_unproven) == ((), ())  # it came to the end of none
    assert report.mission.rows_done == 0  # in truth
    assert "off the row" in report.reason
    assert report.tracking.plants_crushed == 0


def test_one_row_off_towards_the_crop_no_row_counts_once_the_last_lies_on_bare_ground(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, status = drive(tmp_path / "run", PITCH_M, monkeypatch)
    assert not report.ok and report.mission.success is False
    assert status.rows_done == ()
    assert sorted(status.rows_unproven) == [0, 1, 2]
    assert report.mission.rows_unproven == (1, 2, 3)
    assert report.mission.rows_done == 0  # in truth
    assert "no crop row seen over" in report.reason
    assert "maybe one row off" in report.reason
    saved = read_mission(tmp_path / "run")
    assert not any(row.done for row in saved.rows)
    assert saved.covered == ()


def test_on_its_mark_the_same_robot_does_all_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, status = drive(tmp_path / "run", 0.0, monkeypatch)
    assert status.rows_unproven == ()
    assert report.mission.success and report.mission.rows_done == 3, report.reason
    assert report.mission.rows_unproven == ()
